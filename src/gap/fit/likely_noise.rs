//! The effort noise that makes a fit's residuals most probable.

use nalgebra::{Matrix2, Vector2};

use crate::gap::{
    fit::{
        problem::Problem,
        rollout::{Rollout, Start},
        whiten::{Filter, Gain, Local},
        whitening::{Whitening, predict, residual_column, start_ridge},
    },
    model::joint_model::JointModel,
};

/// Largest ratio of the last grid, through which a parabola is laid.
/// derived: the sequence of grids then ends at a ratio of sqrt(2), over which the likelihood of a standard
/// deviation differs from a parabola so little that its top is 4 % off at most.
const FINEST: f64 = 1.5;

/// The effort noise that makes the residuals most probable, by a search over two decades about `around`.
#[must_use]
pub fn most_likely_noise(
    problem: &Problem,
    model: &JointModel,
    starts: &[Start],
    whitening: &mut Whitening,
    around: f64,
) -> f64 {
    let drives = problem.drives(model);
    let mut rollouts = Vec::with_capacity(starts.len());
    for (w, start) in starts.iter().enumerate() {
        let mut rollout = Rollout::default();
        predict(problem, model, &drives, w, *start, &mut rollout);
        let residual = residual_column(model.free());
        // Rollouts do not depend on the noise and are made once; of their columns the likelihood needs
        // three.
        let compact: Vec<[f64; 3]> = rollout.rows.iter().map(|r| [r[0], r[1], r[residual]]).collect();
        rollouts.push(compact);
    }
    let mut score = |sigma: f64| {
        whitening.set_noise(problem, sigma);
        let mut twice = whitening.log_variance;
        let ridge = start_ridge(problem);
        for (w, rows) in rollouts.iter().enumerate() {
            let span = problem.windows[w];
            let (cost, start, gradient) =
                whiten_three(rows, &whitening.locals[span.log][span.start..], &whitening.gains[w]);
            let start = start + ridge;
            let inverse = start.try_inverse().unwrap_or_else(Matrix2::zeros);
            twice += cost - gradient.dot(&(inverse * gradient)) + start.determinant().max(1e-300).ln();
        }
        -0.5 * twice
    };
    let mut best = (score(around), around);
    // The grid moves while a side is better; then its ratio shrinks to the root.
    let mut factor = 4.0f64;
    loop {
        let (middle, center) = best;
        let sides = [center / factor, center * factor].map(|trial| {
            let trial = trial.max(problem.min_sigma_u);
            (score(trial), trial)
        });
        for side in sides {
            if side.0 > best.0 {
                best = side;
            }
        }
        if best.1 != center {
            continue;
        }
        if factor < FINEST {
            // The top of the parabola through the three, on a logarithmic scale.
            let (down, up) = (sides[0].0 - middle, sides[1].0 - middle);
            let shift =
                if down + up < 0.0 { (0.5 * (down - up) / (down + up)).clamp(-0.5, 0.5) } else { 0.0 };
            return (center * factor.powf(shift)).max(problem.min_sigma_u);
        }
        factor = factor.sqrt();
    }
}

/// Whitens (start position, start velocity, residual) and gives their products.
fn whiten_three(rows: &[[f64; 3]], locals: &[Local], gains: &[Gain]) -> (f64, Matrix2<f64>, Vector2<f64>) {
    let mut filter = Filter::<3>::default();
    let mut sums = [0.0; 6];
    for ((row, local), gain) in rows.iter().zip(locals).zip(gains) {
        let mut white = *row;
        filter.pass(&mut white, local, gain);
        let [x, y, e] = white;
        for (sum, term) in sums.iter_mut().zip([x * x, x * y, y * y, x * e, y * e, e * e]) {
            *sum += term;
        }
    }
    (sums[5], Matrix2::new(sums[0], sums[1], sums[1], sums[2]), Vector2::new(sums[3], sums[4]))
}
