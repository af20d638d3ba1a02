//! The most probable noise of a fit's residuals.

use nalgebra::{Matrix2, Vector2};

use crate::{
    fit::{
        noise::EffortNoise,
        problem::{Problem, Weighing},
        rollout::{Rollout, Start},
        whiten::{Filter, Gains, Local},
        whitening::{SIDE_BY_SIDE, Whitening, pass_windows, predict_window, residual_column, start_ridge},
    },
    model::joint_model::JointModel,
};
use numeric::statistics::CHI_SQUARE_999;

/// Ratio of neighboring standard deviations in the first and the last grid, through which a parabola is laid.
/// chosen: over it the log likelihood is nearly a parabola; its maximum is off by 4 % at most.
const FINE: f64 = std::f64::consts::SQRT_2;
/// Largest ratio of neighbors in a grid.
/// chosen: [`FINE`] doubled twice on a logarithmic scale; a missed maximum is found later.
const COARSE: f64 = 4.0;

/// Tried correlation times of a lasting effort, in sample intervals.
/// chosen: from nearly white noise to the length of a window at usual rates; the likelihood is broad in this
/// time.
const MEMORIES: [f64; 3] = [4.0, 16.0, 64.0];
/// Sweeps over the two deviations in turn.
const SWEEPS: usize = 2;
/// Least gain of log likelihood for a lasting effort.
/// derived: half the quantile of chi-square with two degrees of freedom, for size and correlation time.
const ENOUGH: f64 = 0.5 * CHI_SQUARE_999[1];

/// The most probable noise of the residuals, by a search about `around`.
pub fn most_likely_noise(
    problem: &Problem,
    model: &JointModel,
    starts: &[Start],
    whitening: &Whitening,
    around: EffortNoise,
) -> EffortNoise {
    let drives = problem.model_drives(model);
    let mut rollouts = Vec::with_capacity(starts.len());
    for (w, start) in starts.iter().enumerate() {
        let mut rollout = Rollout::default();
        predict_window(problem, model, &drives, w, *start, &mut rollout);
        let residual = residual_column(model.free_count());
        // Rollouts do not depend on the noise, so they are made once; the likelihood needs only three of
        // their columns.
        let compact: Vec<[f64; 3]> = rollout.rows.iter().map(|r| [r[0], r[1], r[residual]]).collect();
        rollouts.push(compact);
    }
    if let Weighing::Predictions { .. } = problem.weighing {
        return EffortNoise {
            deflection: likely_deflection(problem, &rollouts),
            ..EffortNoise::white_noise(problem.min_sigma_u)
        };
    }
    let residuals = Residuals { problem, whitening, rollouts };
    let white = residuals.likely_white(EffortNoise { wander: 0.0, ..around });
    residuals.with_wander(white, around)
}

/// Most probable deflection of whole windows: the squared residuals beyond the best start states, per
/// independent measurement.
fn likely_deflection(problem: &Problem, rollouts: &[Vec<[f64; 3]>]) -> f64 {
    let ridge = start_ridge(problem);
    let squares: f64 = rollouts.iter().map(|rows| square_beyond_start(rows, &ridge)).sum();
    // Two of the independent measurements of a window determine its start state.
    let free = problem.independent_count() - 2.0 * rollouts.len() as f64;
    (squares / free.max(1.0)).sqrt().max(problem.noise_floor())
}

/// Sum of the squared residuals of a window for its best start state.
fn square_beyond_start(rows: &[[f64; 3]], ridge: &Matrix2<f64>) -> f64 {
    let mut sums = Products::default();
    rows.iter().for_each(|row| sums.add_row(row));
    let inverse = (sums.start_matrix() + ridge).try_inverse().unwrap_or_else(Matrix2::zeros);
    sums.residual_square() - sums.start_gradient().dot(&(inverse * sums.start_gradient()))
}

/// Residuals of all windows under a model, to be weighed under any noise.
struct Residuals<'a, 'p, 'c> {
    problem: &'p Problem<'c>,
    whitening: &'a Whitening,
    /// For each window and sample: derivatives by start position and start velocity, residual.
    rollouts: Vec<Vec<[f64; 3]>>,
}

impl Residuals<'_, '_, '_> {
    /// Restricted log likelihood of a noise, up to a constant.
    fn log_likelihood(&self, noise: &EffortNoise) -> f64 {
        let mut log_variance = 0.0;
        let mut rest = Vec::with_capacity(self.rollouts.len());
        let ridge = start_ridge(self.problem);
        let groups = self.problem.windows.chunks(SIDE_BY_SIDE).zip(self.rollouts.chunks(SIDE_BY_SIDE));
        for (windows, rollouts) in groups {
            let mut ways: Vec<WindowPass> =
                rollouts.iter().map(|rows| WindowPass::of_noise(noise, rows)).collect();
            pass_windows(self.problem, &self.whitening.locals, windows, &mut ways, WindowPass::pass_sample);
            for WindowPass { gains, sums, .. } in &ways {
                log_variance += gains.log_variance();
                let start = sums.start_matrix() + ridge;
                let gradient = sums.start_gradient();
                let inverse = start.try_inverse().unwrap_or_else(Matrix2::zeros);
                let determinant = start.determinant().max(1e-300);
                rest.push(sums.residual_square() - gradient.dot(&(inverse * gradient)) + determinant.ln());
            }
        }
        -0.5 * rest.iter().fold(log_variance * self.problem.weighing.counting_share(), |sum, x| sum + x)
    }

    /// The most probable white noise with the wander given, and its log likelihood.
    fn likely_white(&self, from: EffortNoise) -> (f64, EffortNoise) {
        let least = self.problem.min_sigma_u;
        let (reached, white) =
            top_of_likelihood(from.white, least, |white| self.log_likelihood(&EffortNoise { white, ..from }));
        (reached, EffortNoise { white, ..from })
    }

    /// Adds a lasting effort with the best correlation time, if this is more likely.
    fn with_wander(&self, without: (f64, EffortNoise), around: EffortNoise) -> EffortNoise {
        let interval_s = self.problem.coverage.interval_s;
        let least = self.problem.min_sigma_u;
        let mut best = without;
        let mut wander = if around.wander > 0.0 { around.wander } else { without.1.white };
        for intervals in MEMORIES {
            let mut now = EffortNoise { memory_s: intervals * interval_s, wander, ..best.1 };
            let mut reached = f64::NEG_INFINITY;
            for _ in 0..SWEEPS {
                now.wander = top_of_likelihood(now.wander, least, |wander| {
                    self.log_likelihood(&EffortNoise { wander, ..now })
                })
                .1;
                (reached, now) = self.likely_white(now);
            }
            wander = now.wander;
            if reached > best.0 {
                best = (reached, now);
            } else if best.1.wander > 0.0 {
                break;
            }
        }
        if best.0 > without.0 + ENOUGH { best.1 } else { without.1 }
    }
}

/// Maximum of a function of a standard deviation and its location, searched on a logarithmic scale.
fn top_of_likelihood(around: f64, least: f64, mut score: impl FnMut(f64) -> f64) -> (f64, f64) {
    let mut best = (score(around), around);
    // Most searches begin near the maximum. Otherwise the steps grow as long as one side is better.
    let mut factor = FINE;
    loop {
        let (middle, center) = best;
        let sides = [center / factor, center * factor].map(|trial| {
            let trial = trial.max(least);
            (score(trial), trial)
        });
        for side in sides {
            if side.0 > best.0 {
                best = side;
            }
        }
        if best.1 != center {
            factor = (factor * factor).min(COARSE);
        } else if factor > FINE {
            factor = factor.sqrt().max(FINE);
        } else {
            // Maximum of the parabola through the three points, on a logarithmic scale.
            let down = sides[0].0 - middle;
            let up = sides[1].0 - middle;
            let shift =
                if down + up < 0.0 { (0.5 * (down - up) / (down + up)).clamp(-0.5, 0.5) } else { 0.0 };
            return (middle, (center * factor.powf(shift)).max(least));
        }
    }
}

/// A window passing through the filter of a noise.
struct WindowPass<'a> {
    /// For each sample: derivatives by start position and start velocity, residual.
    rows: &'a [[f64; 3]],
    gains: Gains<'a>,
    filter: Filter<3>,
    sums: Products,
}

impl<'a> WindowPass<'a> {
    fn of_noise(noise: &'a EffortNoise, rows: &'a [[f64; 3]]) -> Self {
        Self { rows, gains: Gains::of_noise(noise), filter: Filter::default(), sums: Products::default() }
    }

    #[inline]
    fn pass_sample(&mut self, local: &Local, reading: f64, at: usize) {
        let mut white = self.rows[at];
        self.filter.pass_row(&mut white, local, &self.gains.next(local, reading));
        self.sums.add_row(&white);
    }
}

/// Sums of products of the three columns of a row.
#[derive(Default)]
struct Products([f64; 6]);

impl Products {
    #[inline]
    fn add_row(&mut self, row: &[f64; 3]) {
        let [x, y, e] = *row;
        for (sum, term) in self.0.iter_mut().zip([x * x, x * y, y * y, x * e, y * e, e * e]) {
            *sum += term;
        }
    }

    fn residual_square(&self) -> f64 {
        self.0[5]
    }

    fn start_matrix(&self) -> Matrix2<f64> {
        Matrix2::new(self.0[0], self.0[1], self.0[1], self.0[2])
    }

    fn start_gradient(&self) -> Vector2<f64> {
        Vector2::new(self.0[3], self.0[4])
    }
}
