//! Multiple shooting: parameters, start states of all windows and the effort noise, by damped Gauss-Newton
//! with the start states eliminated window by window. See docs/method.md (14.11).

use nalgebra::{DMatrix, DVector, Matrix2, Vector2};

use crate::{
    fit::{
        acting::{MAX_COLUMNS, Row},
        damping,
        jackknife::{Witness, alike_windows, jackknife_covariance},
        likely_noise::most_likely_noise,
        noise::EffortNoise,
        problem::Problem,
        rollout::{MAX_FREE, Rollout, Start, column_count},
        starts::improve_starts,
        whiten::whiten_rows,
        whitening::{Whitening, predict_window, residual_column, start_ridge},
    },
    model::{
        effect::{LARGEST_RATIO, Place},
        joint_model::{JointModel, SETTLE_S},
    },
};

/// Most free parameters of a fit, the lag included.
pub const MAX_FIT_FREE: usize = MAX_FREE - 1;

/// A fitted model.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The model.
    pub model: JointModel,
    /// Start state of each window.
    pub starts: Vec<Start>,
    /// Unexplained effort.
    pub noise: EffortNoise,
    /// Restricted log likelihood.
    pub log_likelihood: f64,
    /// Covariance of the free parameters; rows of frozen ones are zero.
    pub covariance: DMatrix<f64>,
    /// Number of windows determining each free parameter, if all did so equally.
    pub witnesses: Vec<f64>,
    /// Sum of the squared whitened residuals of each window.
    pub costs: Vec<f64>,
}

impl Fit {
    /// Standard deviation of a free parameter.
    pub fn parameter_deviation(&self, parameter: usize) -> f64 {
        self.covariance[(parameter, parameter)].max(0.0).sqrt()
    }
}

/// Normal equations of one window.
#[derive(Clone)]
struct Block {
    cost: f64,
    hessian: DMatrix<f64>,
    start: Matrix2<f64>,
    cross: DMatrix<f64>,
    start_gradient: Vector2<f64>,
    gradient: DVector<f64>,
}

/// Normal equations of all windows.
struct Normal {
    blocks: Vec<Block>,
    hessian: DMatrix<f64>,
    gradient: DVector<f64>,
}

/// Which unknowns of a fit are free.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Free {
    /// Parameters, lag and start states.
    All,
    /// Start states only.
    Starts,
}

struct Evaluation {
    normal: Normal,
    /// Total cost, priors included.
    cost: f64,
}

/// Whitened normal equations at a model and start states; `frozen` parameters have columns of zeros.
fn normal_equations(
    problem: &Problem,
    model: &JointModel,
    starts: &[Start],
    whitening: &Whitening,
    frozen: &[bool],
) -> Evaluation {
    // A constant number of columns lets the compiler unroll and vectorize the loops over them.
    match column_count(model.free_count()) {
        4 => evaluate_columns::<4>(problem, model, starts, whitening, frozen),
        8 => evaluate_columns::<8>(problem, model, starts, whitening, frozen),
        12 => evaluate_columns::<12>(problem, model, starts, whitening, frozen),
        _ => evaluate_columns::<MAX_COLUMNS>(problem, model, starts, whitening, frozen),
    }
}

fn evaluate_columns<const W: usize>(
    problem: &Problem,
    model: &JointModel,
    starts: &[Start],
    whitening: &Whitening,
    frozen: &[bool],
) -> Evaluation {
    let drives = problem.model_drives(model);
    let free = model.free_count();
    let mut rollout = Rollout::default();
    let mut blocks = Vec::with_capacity(starts.len());
    let ridge = start_ridge(problem);
    let residual = residual_column(free);
    for (w, start) in starts.iter().enumerate() {
        predict_window(problem, model, &drives, w, *start, &mut rollout);
        let span = problem.windows[w];
        // The residual is stored after the sensitivities, so one filter whitens both (14.10).
        whiten_rows::<W>(&mut rollout.rows, &whitening.locals[span.log][span.start..], &whitening.gains[w]);
        let sums = upper_products::<W>(&rollout.rows);
        // A frozen parameter keeps its column, with zeros, so the model's indices stay valid.
        blocks.push(Block {
            cost: sums[residual][residual],
            hessian: DMatrix::from_fn(free, free, |i, j| {
                if frozen[i] || frozen[j] { 0.0 } else { sums[2 + i.min(j)][2 + i.max(j)] }
            }),
            start: Matrix2::new(sums[0][0], sums[0][1], sums[0][1], sums[1][1]) + ridge,
            cross: DMatrix::from_fn(2, free, |i, j| if frozen[j] { 0.0 } else { sums[i][2 + j] }),
            start_gradient: Vector2::new(sums[0][residual], sums[1][residual]),
            gradient: DVector::from_fn(free, |i, _| if frozen[i] { 0.0 } else { sums[2 + i][residual] }),
        });
    }
    total_of_windows(problem, model, blocks, frozen)
}

/// Sums the windows and adds the prior of the lag.
fn total_of_windows(
    problem: &Problem,
    model: &JointModel,
    blocks: Vec<Block>,
    frozen: &[bool],
) -> Evaluation {
    let free = model.free_count();
    let mut hessian = DMatrix::zeros(free, free);
    let mut gradient = DVector::zeros(free);
    for b in &blocks {
        hessian += &b.hessian;
        gradient += &b.gradient;
    }
    let lag = model.lag_s / problem.lag_sigma_s;
    let cost = blocks.iter().map(|b| b.cost).sum::<f64>() + lag * lag;
    let cost = if cost.is_finite() { cost } else { f64::INFINITY };
    // The lag's prior is one more squared residual; parameter 0 is always the lag.
    if !frozen[0] {
        hessian[(0, 0)] += 1.0 / (problem.lag_sigma_s * problem.lag_sigma_s);
        gradient[0] -= lag / problem.lag_sigma_s;
    }
    Evaluation { normal: Normal { blocks, hessian, gradient }, cost }
}

/// The upper triangle of `rows' * rows` over the first `W` columns.
fn upper_products<const W: usize>(rows: &[Row]) -> [[f64; W]; W] {
    let mut sums = [[0.0; W]; W];
    for row in rows {
        for i in 0..W {
            let x = row[i];
            // Starting at an even column, the loop runs over whole pairs and vectorizes.
            for j in i & !1..W {
                sums[i][j] += x * row[j];
            }
        }
    }
    sums
}

/// A step of all unknowns: parameters and start states.
struct Step {
    parameters: DVector<f64>,
    starts: Vec<Vector2<f64>>,
}

fn damped_step(normal: &Normal, frozen: &[bool], damping: f64) -> Option<Step> {
    let mut s = normal.hessian.clone();
    let mut g = normal.gradient.clone();
    let inverses: Vec<Matrix2<f64>> =
        normal.blocks.iter().map(|b| b.start.try_inverse().unwrap_or_else(Matrix2::zeros)).collect();
    for (b, inverse) in normal.blocks.iter().zip(&inverses) {
        // (14.11): residuals a window's free start state could explain do not determine parameters.
        let weighted = b.cross.transpose() * inverse;
        s -= &weighted * &b.cross;
        g -= &weighted * b.start_gradient;
    }
    for i in 0..g.len() {
        if frozen[i] {
            // A unit row with zero gradient: the step is zero, and the matrix stays invertible.
            s[(i, i)] = 1.0;
            g[i] = 0.0;
        } else {
            // Marquardt's scaling by the diagonal is independent of units. The two small terms keep the
            // matrix regular even if no window determines a parameter.
            s[(i, i)] = s[(i, i)] * (1.0 + damping) + 1e-12 * normal.hessian[(i, i)] + 1e-300;
        }
    }
    let parameters = s.cholesky()?.solve(&g);
    let starts = normal
        .blocks
        .iter()
        .zip(&inverses)
        .map(|(b, inverse)| inverse * (b.start_gradient - &b.cross * &parameters))
        .collect();
    Some(Step { parameters, starts })
}

/// Bounds of an actuator's gain and damping: it must drive, and it must brake.
/// chosen: a gain beyond the largest ratio would be a difference of units; a damping has no upper bound.
const ACTUATOR_BOUNDS: [(f64, f64); 2] = [(1.0 / LARGEST_RATIO, LARGEST_RATIO), (0.0, 1e9)];

/// Largest lag, in deviations of its prior: a larger one would imitate the effect `delay`.
/// chosen: no lag in the prior is larger.
const MOST_LAG: f64 = 5.0;

/// The model after a step of its parameters, kept within their bounds.
pub fn moved_model(problem: &Problem, model: &JointModel, step: &DVector<f64>) -> JointModel {
    let mut parameters = model.free_parameters();
    let mut at = 1;
    parameters[0] =
        (parameters[0] + step[0]).clamp(-MOST_LAG * problem.lag_sigma_s, MOST_LAG * problem.lag_sigma_s);
    for term in &model.terms {
        for i in 0..term.p.len() {
            let (low, high) = problem.catalogue[term.effect].parameter_bounds(i, &problem.coverage);
            parameters[at] = (parameters[at] + step[at]).clamp(low, high);
            at += 1;
        }
    }
    for (i, (low, high)) in model.actuator_columns().iter().zip(ACTUATOR_BOUNDS) {
        if let Some(i) = *i {
            parameters[i] = (parameters[i] + step[i]).clamp(low, high);
        }
    }
    model.with_parameters(&parameters)
}

/// Shares of the effort noise for the first rounds of a fit with play, and of the last fits with a contact.
/// The twin's noise includes the missing effects; under this noise a window started on the wrong side of the
/// gap would never leave it.
/// tuned: tests/python/gap/generate.py.
const ANNEALING: &[f64] = &[0.3, 0.1, 0.03];

/// Limits on the length of a fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// Rounds; the noise is estimated anew between them.
    pub rounds: usize,
    /// Most steps per round.
    pub steps: usize,
    /// A round ends at a step gaining less than this times `1 + ENOUGH_OF_COST * cost`.
    pub enough: f64,
    /// Whether the settle time of friction is fitted as well.
    pub settles: bool,
    /// Whether start states are searched in every window; otherwise the given ones come from a similar model,
    /// and only badly fitting windows are searched.
    pub searches: bool,
    /// Whether the noise is estimated before the first round as well.
    pub hears: bool,
}

/// Most steps of one round.
const MAX_STEPS: usize = 14;
/// Least gain of log likelihood by a step for another one to follow.
/// chosen: a parameter is then within a standard deviation of its best.
const ENOUGH: f64 = 0.2;
/// Growth of the least gain with the cost, as a share per unit of cost.
/// chosen: among many residuals single ones do not matter.
const ENOUGH_OF_COST: f64 = 6e-5;
/// Damping at the start of a fit.
/// chosen: small, as most fits start near their optimum.
pub(super) const FIRST_DAMPING: f64 = 1e-4;

impl Pace {
    /// Until the fit converges.
    pub const fn thorough(rounds: usize) -> Self {
        Self { rounds, steps: MAX_STEPS, enough: ENOUGH, settles: true, searches: true, hears: false }
    }

    /// From a start near the optimum.
    pub const WARM: Self =
        Self { rounds: 1, steps: 6, enough: ENOUGH, settles: false, searches: false, hears: false };
    /// Far enough to see which of several starts is best.
    pub const FIRST: Self =
        Self { rounds: 1, steps: 4, enough: 2.0, settles: false, searches: true, hears: false };
    /// From there on, far enough to see which candidates lead.
    pub const NEXT: Self = Self { searches: false, hears: true, ..Self::FIRST };
}

/// Fits from a starting model; `starts` may come from an earlier fit of a similar model.
pub fn shooting_fit(
    problem: &Problem,
    model: &JointModel,
    starts: Option<&[Start]>,
    noise: EffortNoise,
    free: Free,
    pace: Pace,
) -> Fit {
    let mut best = fit_settled(problem, model, starts, noise, free, pace);
    // Without friction the settle time has no effect.
    if !pace.settles || free != Free::All || !model.has_friction(problem.catalogue) {
        return best;
    }
    // Longer settle times first, as long as they help; then shorter ones.
    let at = |fit: &Fit| SETTLE_S.iter().position(|s| *s >= fit.model.settle_s).unwrap_or(0);
    for longer in [true, false] {
        loop {
            let next = if longer { at(&best) + 1 } else { at(&best).wrapping_sub(1) };
            let Some(&settle_s) = SETTLE_S.get(next) else { break };
            let trial = JointModel { settle_s, ..best.model.clone() };
            // The next settle time changes little: a fit started from the present states needs few steps.
            let trial_pace = Pace { rounds: 2, steps: 4, searches: false, ..pace };
            let trial = fit_settled(problem, &trial, Some(&best.starts), best.noise, free, trial_pace);
            // Negated, so a NaN likelihood ends the search.
            if !(trial.log_likelihood > best.log_likelihood + ENOUGH_TO_SETTLE) {
                break;
            }
            best = trial;
        }
    }
    best
}

/// Least gain of log likelihood for another settle time.
/// derived: half the 95 % quantile of chi-square with one degree of freedom.
const ENOUGH_TO_SETTLE: f64 = 1.920_729;

/// Fits with the model's settle time.
fn fit_settled(
    problem: &Problem,
    model: &JointModel,
    starts: Option<&[Start]>,
    noise: EffortNoise,
    free: Free,
    pace: Pace,
) -> Fit {
    let mut model = model.clone();
    let mut starts = starts.map_or_else(|| problem.smoothed_starts(&model), <[Start]>::to_vec);
    let mut noise = problem.weighing.first_noise(noise, problem);
    let mut frozen = vec![free == Free::Starts; model.free_count()];
    // Lag and delay add up to one shift of the effort; with both free, neither would be determined.
    frozen[0] |= model.scalar_of(problem.catalogue, Place::Delay).is_some();
    let has_play = model.position_sensor(problem.catalogue).half_gap > 0.0;
    let mut whitening = Whitening::new(problem, &model, &noise);
    let has_contact = model.terms.iter().any(|t| problem.catalogue[t.effect].place() == Place::Contact);
    let anneal = if free == Free::All && pace.searches && (has_play || (has_contact && pace.settles)) {
        ANNEALING
    } else {
        &[]
    };
    // Annealing: with little noise first, the misfit of windows is not taken for noise.
    for share in anneal {
        whitening = Whitening::new(problem, &model, &noise.scaled_by(*share).at_least(problem.min_sigma_u));
        improve_starts(problem, &model, &mut starts, &whitening, true);
        let now = normal_equations(problem, &model, &starts, &whitening, &frozen);
        iterate(problem, &mut model, &mut starts, &whitening, &frozen, pace, now);
    }
    let mut end = None;
    for round in 0..pace.rounds.max(1) {
        // An unfitted model leaves its misfit in the residuals, and the estimate would take this for noise.
        if round > 0 || !anneal.is_empty() || pace.hears {
            noise = most_likely_noise(problem, &model, &starts, &whitening, noise);
            whitening = Whitening::new(problem, &model, &noise);
        }
        // Gauss-Newton cannot move a start state across the play, so with play every round searches all
        // windows.
        improve_starts(problem, &model, &mut starts, &whitening, (round == 0 && pace.searches) || has_play);
        let now = normal_equations(problem, &model, &starts, &whitening, &frozen);
        end = Some(iterate(problem, &mut model, &mut starts, &whitening, &frozen, pace, now));
    }
    let end = end.unwrap_or_else(|| normal_equations(problem, &model, &starts, &whitening, &frozen));
    let log_likelihood = restricted_likelihood(problem, &model, &end, &whitening);
    let (matrix, windows) = window_witnesses(&end.normal);
    let (covariance, witnesses) =
        jackknife_covariance(matrix, &windows, &alike_windows(problem), noise.has_remainder(), &frozen);
    let costs = end.normal.blocks.iter().map(|b| b.cost).collect();
    Fit { model, starts, noise, log_likelihood, covariance, witnesses, costs }
}

/// Iterates from `now`, the equations at the model and the start states; returns the equations at the end.
fn iterate(
    problem: &Problem,
    model: &mut JointModel,
    starts: &mut Vec<Start>,
    whitening: &Whitening,
    frozen: &[bool],
    pace: Pace,
    mut now: Evaluation,
) -> Evaluation {
    let mut damping = FIRST_DAMPING;
    for _ in 0..pace.steps {
        let Some(step) = damped_step(&now.normal, frozen, damping) else {
            damping = (damping * 10.0).max(FIRST_DAMPING);
            continue;
        };
        let trial_model = moved_model(problem, model, &step.parameters);
        let mut trial_starts: Vec<Start> = starts
            .iter()
            .zip(&step.starts)
            .map(|(s, d)| Start { position: s.position + d[0], velocity: s.velocity + d[1], play: s.play })
            .collect();
        let mut trial = normal_equations(problem, &trial_model, &trial_starts, whitening, frozen);
        if !(trial.cost < now.cost) {
            // Keep the better start state under the new parameters, window by window.
            let kept = normal_equations(problem, &trial_model, starts, whitening, frozen).normal.blocks;
            let mut blocks = trial.normal.blocks;
            for (w, own) in kept.into_iter().enumerate() {
                if !(blocks[w].cost <= own.cost) {
                    (blocks[w], trial_starts[w]) = (own, starts[w]);
                }
            }
            trial = total_of_windows(problem, &trial_model, blocks, frozen);
        }
        if trial.cost < now.cost {
            let gained = now.cost - trial.cost;
            (*model, *starts, now) = (trial_model, trial_starts, trial);
            damping = (damping * damping::FALL).max(damping::LEAST);
            if gained < pace.enough * (1.0 + ENOUGH_OF_COST * now.cost) {
                break;
            }
        } else {
            damping = (damping * damping::RISE).max(damping::LEAST_RISEN);
            if damping > 1e5 {
                break;
            }
        }
    }
    now
}

/// Contribution of every window with its start state eliminated, and the matrix of all.
fn window_witnesses(normal: &Normal) -> (DMatrix<f64>, Vec<Witness>) {
    let mut matrix = normal.hessian.clone();
    let mut windows = Vec::with_capacity(normal.blocks.len());
    for b in &normal.blocks {
        // A window with an undetermined start state contributes nothing.
        let Some(inverse) = b.start.try_inverse() else {
            let n = b.hessian.nrows();
            windows.push(Witness { hessian: DMatrix::zeros(n, n), gradient: DVector::zeros(n) });
            continue;
        };
        let weighted = b.cross.transpose() * inverse;
        let lost = &weighted * &b.cross;
        matrix -= &lost;
        windows.push(Witness {
            hessian: &b.hessian - lost,
            gradient: &b.gradient - &weighted * b.start_gradient,
        });
    }
    (matrix, windows)
}

/// Log likelihood with the start states integrated out, up to a constant. See docs/method.md (14.12).
fn restricted_likelihood(
    problem: &Problem,
    model: &JointModel,
    at: &Evaluation,
    whitening: &Whitening,
) -> f64 {
    let lag = model.lag_s / problem.lag_sigma_s;
    let mut twice = whitening.log_variance + lag * lag;
    for b in &at.normal.blocks {
        let inverse = b.start.try_inverse().unwrap_or_else(Matrix2::zeros);
        // Integrating out a start state subtracts the cost reduction of its best step and adds the log
        // determinant.
        twice += b.cost - b.start_gradient.dot(&(inverse * b.start_gradient))
            + b.start.determinant().max(1e-300).ln();
    }
    -0.5 * twice
}
