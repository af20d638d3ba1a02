//! Residuals of all windows under a model, and their whitening filter.

use nalgebra::Matrix2;

use crate::{
    fit::{
        noise::EffortNoise,
        problem::Problem,
        rollout::{Rollout, Start, roll_window},
        whiten::{Gain, Gains, Local, linearized_joint},
    },
    model::joint_model::JointModel,
    record::{drive::Drive, log::Span},
};

/// Column of the residual in the whitened rows: after the sensitivities.
pub fn residual_column(free: usize) -> usize {
    2 + free
}

/// The whitening filter of a fit.
pub struct Whitening {
    /// Local linearizations of each log.
    pub locals: Vec<Vec<Local>>,
    /// Gains of each window.
    pub gains: Vec<Vec<Gain>>,
    /// Sum of the log variances.
    pub log_variance: f64,
}

impl Whitening {
    /// The filter for a model and a noise.
    pub fn new(problem: &Problem, model: &JointModel, noise: &EffortNoise) -> Self {
        let each = problem.logs.iter().enumerate();
        let locals: Vec<Vec<Local>> =
            each.map(|(i, l)| linearized_joint(model, problem.catalogue, l, i, &problem.traces[i])).collect();
        let mut log_variance = 0.0;
        let mut gains = Vec::with_capacity(problem.windows.len());
        for windows in problem.windows.chunks(SIDE_BY_SIDE) {
            let each = windows.iter().map(|w| (Gains::of_noise(noise), Vec::with_capacity(w.len)));
            let mut ways: Vec<(Gains, Vec<Gain>)> = each.collect();
            pass_windows(problem, &locals, windows, &mut ways, |(gains, out), local, reading, _| {
                out.push(gains.next(local, reading));
            });
            for (way, out) in ways {
                log_variance += way.log_variance();
                gains.push(out);
            }
        }
        Self { locals, gains, log_variance: log_variance * problem.weighing.counting_share() }
    }
}

/// Number of windows passed side by side.
/// measured: with four, gains and likelihoods take 0.55 of the time of one at a time (profiles of a
/// diagnosis, 2026-11-28).
pub const SIDE_BY_SIDE: usize = 4;

/// Goes through windows side by side: each sample waits for the divisions of the one before, and samples of
/// other windows fill this time. `each` receives the state of a window, the linearization, the variance of
/// the reading and the index of the sample in the window.
#[inline]
pub fn pass_windows<T>(
    problem: &Problem,
    locals: &[Vec<Local>],
    windows: &[Span],
    states: &mut [T],
    mut each: impl FnMut(&mut T, &Local, f64, usize),
) {
    let longest = windows.iter().map(|w| w.len).max().unwrap_or(0);
    for k in 0..longest {
        for (span, state) in windows.iter().zip(&mut *states) {
            if k < span.len {
                let at = span.start + k;
                each(state, &locals[span.log][at], problem.readings[span.log][at], k);
            }
        }
    }
}

/// Residuals and sensitivities of a window, not yet whitened.
pub fn predict_window(
    problem: &Problem,
    model: &JointModel,
    drives: &[Drive],
    window: usize,
    start: Start,
    out: &mut Rollout,
) {
    let span = problem.windows[window];
    let log = &problem.logs[span.log];
    roll_window(model, problem.catalogue, log, &drives[span.log], span, start, out);
    let residual = residual_column(model.free_count());
    for (k, row) in out.rows.iter_mut().enumerate() {
        row[residual] = log.position[span.start + k] - out.position[k];
    }
}

/// Prior of the start states, only there to determine the velocity of a stuck joint.
pub fn start_ridge(problem: &Problem) -> Matrix2<f64> {
    let range = problem.coverage.position.1 - problem.coverage.position.0;
    let q = (range + problem.noise.at_rest).max(1e-9);
    let v = problem.coverage.speed.1.max(range).max(1e-9);
    // derived: deviations of ten times the range and ten times the top speed; any moving window outweighs
    // them.
    Matrix2::new(1e-2 / (q * q), 0.0, 0.0, 1e-2 / (v * v))
}

#[cfg(test)]
#[path = "whitening_tests.rs"]
mod tests;
