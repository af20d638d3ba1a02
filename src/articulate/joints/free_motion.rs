//! The motion of a part without a joint, with its covariance.

use nalgebra::{DMatrix, DVector, Matrix6, Vector3, Vector6};

use crate::joints::{minimise::minimise, motion_evidence::MotionEvidence, quadratic::Quadratic};
use geometry::{Pose, exp_so3};

/// Gauss-Newton iterations at most.
pub(crate) const ITERATIONS: usize = 30;
/// Smallest standard deviation of a surface residual, as a share of the reach: poses and surfaces have
/// systematic errors of this size, whatever the number of points.
///
/// tuned: shared/bags
const SIGMA_FLOOR: f64 = 0.02;
/// Degrees of freedom of a rigid motion.
///
/// derived: three of translation, three of rotation
pub(crate) const FREEDOMS: f64 = 6.0;

/// The motion of a joint's parent between the states.
#[derive(Clone, Debug)]
pub struct ParentMotion {
    /// Its `state1_from_state0` in the world; the identity for the static part.
    pub state1_from_state0: Pose,
    /// Covariance of a left perturbation (translation 3, rotation 3) of the motion, square meters and
    /// radians; zero for the static part.
    pub covariance: Matrix6<f64>,
    /// Effect of the drawn errors of poses and depth common to all parts: one left perturbation per draw, on
    /// top of the covariance; empty where these errors are unknown or zero.
    pub drawn: Vec<Vector6<f64>>,
}

impl ParentMotion {
    /// Left perturbation of the motion by a draw.
    pub fn drawn_perturbation(&self, draw: usize) -> Vector6<f64> {
        self.drawn.get(draw).copied().unwrap_or_default()
    }

    /// The motion of the static part: identity, without error.
    pub fn static_part() -> Self {
        Self { state1_from_state0: Pose::identity(), covariance: Matrix6::zeros(), drawn: Vec::new() }
    }
}

/// The fit of a rigid motion.
#[derive(Clone, Debug)]
pub(crate) struct FreeFit {
    pub motion: Pose,
    /// Quadratic model of the cost at the end.
    pub quadratic: Quadratic,
    /// Standard deviation of a surface residual, meters.
    pub sigma_m: f64,
    /// Ratio of the squared error of the motion to that expected of independent residuals.
    pub dispersion: f64,
}

impl FreeFit {
    /// Fits a rigid motion to evidence twice: first with the standard deviation of the surface residuals at
    /// the start, then with that at the motion found.
    pub(crate) fn new(start: &Pose, evidence: &MotionEvidence) -> Self {
        // Far from the true motion residuals are large; only near it they have the scale of the errors.
        let (near, _) = fitted_motion(start, evidence, surface_sigma_m(evidence, start));
        let sigma_m = surface_sigma_m(evidence, &near);
        let (motion, quadratic) = fitted_motion(&near, evidence, sigma_m);
        // Errors may exceed the stated ones within blocks or across them: the larger excess counts.
        let scale = quadratic.cost / quadratic.independent.max(2.0);
        let dispersion = scale.max(quadratic.dispersion());
        Self { motion, quadratic, sigma_m, dispersion }
    }

    /// Number of independent residuals.
    pub(crate) fn independent_residuals(&self) -> f64 {
        self.quadratic.independent.max(2.0)
    }
}

/// Standard deviation of the surface residuals at a motion, meters, at least the systematic error.
pub(crate) fn surface_sigma_m(evidence: &MotionEvidence, motion: &Pose) -> f64 {
    evidence.surface_sigma_m(motion, evidence.reach_m * SIGMA_FLOOR)
}

fn fitted_motion(start: &Pose, evidence: &MotionEvidence, sigma_m: f64) -> (Pose, Quadratic) {
    minimise(
        *start,
        ITERATIONS,
        |motion| evidence.linearise(motion, sigma_m),
        |q| q.cost,
        |_, q| {
            let information = DMatrix::from_column_slice(6, 6, q.information.as_slice());
            (information, DVector::from_column_slice(q.gradient.as_slice()))
        },
        |motion, s| {
            let turn = exp_so3(&Vector3::new(s[3], s[4], s[5]));
            Pose::from_parts(Vector3::new(s[0], s[1], s[2]).into(), turn) * motion
        },
    )
}

/// The motion of a part without a joint, with its covariance, which is zero where some direction is not
/// observed.
pub(crate) fn free_motion(start: &Pose, evidence: &MotionEvidence) -> ParentMotion {
    let free = FreeFit::new(start, evidence);
    let displacements = free.quadratic.displacement_covariance();
    let inverse = free.quadratic.information.cholesky().map(|c| c.inverse());
    // Zeros mark an unobserved direction, as `static_motion` expects.
    let covariance = inverse.map_or_else(Matrix6::zeros, |c| c * free.dispersion + c * displacements * c);
    // The motion shifts so that it cancels the change of the gradient in a draw.
    let drawn = match inverse {
        Some(c) => evidence.drawn_gradients(&free.motion, free.sigma_m).iter().map(|g| -(c * g)).collect(),
        None => Vec::new(),
    };
    ParentMotion { state1_from_state0: free.motion, covariance, drawn }
}
