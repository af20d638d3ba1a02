//! The residuals of all windows under a model, and the filter that makes them white.

use nalgebra::Matrix2;

use crate::gap::{
    fit::{
        noise::EffortNoise,
        problem::Problem,
        rollout::{Rollout, Start, roll},
        whiten::{Gain, Local, gains, linearize},
    },
    model::joint_model::JointModel,
    record::drive::Drive,
};

/// Column of the residual in the rows that are whitened: the one behind the sensitivities.
#[must_use]
pub fn residual_column(free: usize) -> usize {
    2 + free
}

/// Noise of a fit: local linearizations, gains of each window, the sum of log variances.
pub struct Whitening {
    /// Of each log.
    pub locals: Vec<Vec<Local>>,
    /// Of each window.
    pub gains: Vec<Vec<Gain>>,
    /// Sum of the log variances.
    pub log_variance: f64,
}

impl Whitening {
    /// The filter of a model and a noise level.
    #[must_use]
    pub fn new(problem: &Problem, model: &JointModel, noise: &EffortNoise) -> Self {
        let each = problem.logs.iter().enumerate();
        let locals =
            each.map(|(i, l)| linearize(model, problem.catalogue, l, i, &problem.traces[i])).collect();
        let mut whitening =
            Self { locals, gains: vec![Vec::new(); problem.windows.len()], log_variance: 0.0 };
        whitening.set_noise(problem, noise);
        whitening
    }

    /// Another noise level.
    pub fn set_noise(&mut self, problem: &Problem, noise: &EffortNoise) {
        // The linearizations do not depend on the noise: another level needs new gains only.
        self.log_variance = 0.0;
        for (w, out) in problem.windows.iter().zip(&mut self.gains) {
            self.log_variance += gains(&self.locals[w.log], *w, &problem.readings[w.log], noise, out);
        }
        self.log_variance *= problem.weighing.share();
    }
}

/// Residuals and sensitivities of a window, not yet whitened.
pub fn predict(
    problem: &Problem,
    model: &JointModel,
    drives: &[Drive],
    window: usize,
    start: Start,
    out: &mut Rollout,
) {
    let span = problem.windows[window];
    let log = &problem.logs[span.log];
    roll(model, problem.catalogue, log, &drives[span.log], span, start, out);
    let residual = residual_column(model.free());
    for (k, row) in out.rows.iter_mut().enumerate() {
        row[residual] = log.position[span.start + k] - out.position[k];
    }
}

/// Start-state prior that only keeps a stuck joint's velocity from being undetermined.
#[must_use]
pub fn start_ridge(problem: &Problem) -> Matrix2<f64> {
    let range = problem.coverage.position.1 - problem.coverage.position.0;
    let (q, v) = ((range + problem.noise.at_rest).max(1e-9), problem.coverage.speed.1.max(range).max(1e-9));
    // Deviations of ten times the range and the top speed: any moving window outweighs them.
    Matrix2::new(1e-2 / (q * q), 0.0, 0.0, 1e-2 / (v * v))
}
