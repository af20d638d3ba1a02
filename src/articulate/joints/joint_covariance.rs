//! Covariances of a fitted joint: of its parameters, its axis and its motions.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector, Matrix6, SMatrix, Vector6};

use crate::joints::{
    joint_fit::{FreeFits, JointFit},
    joint_motion::{Freedom, frame_across},
    quadratic::Source,
};

/// Covariance of the parameters of a joint.
pub(crate) struct JointCovariance<'a> {
    fit: &'a JointFit,
    found: &'a FreeFits<'a>,
    /// Ratio of the squared error of the axis to that expected of independent residuals.
    pub dispersion: f64,
    /// Covariance from the residuals and displacements of the surfaces; `None` where some direction is not
    /// observed.
    own: Option<DMatrix<f64>>,
    /// Covariance from these and from the motions of the parents.
    total: Option<DMatrix<f64>>,
    /// Changes of the parameters by drawn errors of poses and depth, per draw.
    drawn: Vec<DVector<f64>>,
}

impl<'a> JointCovariance<'a> {
    pub(crate) fn new(fit: &'a JointFit, found: &'a FreeFits<'a>) -> Self {
        let dispersion = found.dispersion * shared_error(fit);
        let own = fit.inverse.as_ref().map(|c| own_covariance(c, fit, dispersion));
        // Errors of the parents are not this part's: its motions contain them once, its axis through the fit.
        let drawn = fit.inverse.as_ref().map_or_else(Vec::new, |c| drawn_parameters(c, fit, found));
        let total = own.as_ref().zip(fit.inverse.as_ref()).map(|(own, c)| {
            let squares = drawn.iter().map(|d| d * d.transpose());
            let of_draws = squares.fold(DMatrix::zeros(c.nrows(), c.ncols()), |sum, square| sum + square);
            total_covariance(own, c, fit, found) + of_draws / drawn.len().max(1) as f64
        });
        Self { fit, found, dispersion, own, total, drawn }
    }

    /// Standard deviation of the position in motion `k`; infinite where it is not observed.
    pub(crate) fn position_std(&self, k: usize) -> f64 {
        let at = self.fit.joint.axis_dimension() + k;
        self.total.as_ref().map_or(f64::INFINITY, |c| c[(at, at)].max(0.0).sqrt())
    }

    /// Covariance of a left perturbation of motion `k` in the world.
    pub(crate) fn motion_covariance(&self, k: usize) -> Matrix6<f64> {
        let t = &self.fit.tangents[k];
        let own = self.own.as_ref().map(|c| t * c * t.transpose());
        let own = own.map_or_else(Matrix6::zeros, |c| Matrix6::from_fn(|r, k| c[(r, k)]));
        own + self.found.parent_motion(k).covariance
    }

    /// Left perturbation of motion `k` in the world in every draw, on top of its covariance.
    pub(crate) fn drawn_motion(&self, k: usize) -> Vec<Vector6<f64>> {
        let parent = self.found.parent_motion(k);
        let own = self.drawn.iter().map(|by| &self.fit.tangents[k] * by);
        own.enumerate()
            .map(|(draw, own)| parent.drawn_perturbation(draw) + Vector6::from_fn(|r, _| own[r]))
            .collect()
    }

    /// Covariance of (direction 3, point 3, motion 1, pitch 1), where the motion is number `farthest`. The
    /// axis is reversed if this motion is negative. Infinite where some direction is not observed.
    pub(crate) fn axis_covariance(&self, farthest: usize) -> SMatrix<f64, 8, 8> {
        let Some(total) = &self.total else { return SMatrix::from_element(f64::INFINITY) };
        let joint = &self.fit.joint;
        let (a, b) = frame_across(&joint.direction);
        // Direction and point move along two vectors perpendicular to the axis, as in `PlacedJoint::stepped`.
        let mut to = DMatrix::zeros(8, joint.dimension());
        to.fixed_view_mut::<3, 1>(0, 0).copy_from(&a);
        to.fixed_view_mut::<3, 1>(0, 1).copy_from(&b);
        if joint.freedom != Freedom::Slide {
            to.fixed_view_mut::<3, 1>(3, 2).copy_from(&a);
            to.fixed_view_mut::<3, 1>(3, 3).copy_from(&b);
        }
        if joint.freedom == Freedom::Helix {
            to[(7, 4)] = 1.0;
        }
        to[(6, joint.axis_dimension() + farthest)] = 1.0;
        let full = &to * total * to.transpose();
        directed_covariance(&full, joint.positions[farthest] >= 0.0)
    }
}

/// The covariance of (direction 3, point 3, motion 1, pitch 1) with the axis reversed unless it points
/// `forward`.
fn directed_covariance(covariance: &DMatrix<f64>, forward: bool) -> SMatrix<f64, 8, 8> {
    // Direction and motion change their sign together; the point and the pitch stay.
    let turned = |i: usize| !forward && !(3..6).contains(&i) && i != 7;
    SMatrix::from_fn(|r, c| if turned(r) == turned(c) { covariance[(r, c)] } else { -covariance[(r, c)] })
}

/// Covariance of the parameters due to residuals and to displacements of the surfaces.
fn own_covariance(inverse: &DMatrix<f64>, fit: &JointFit, dispersion: f64) -> DMatrix<f64> {
    let mut covariance = inverse * dispersion;
    for (q, t) in fit.quadratics.iter().zip(&fit.tangents) {
        // Displacements leave no residual, so the dispersion does not include them, docs/method.md (8.12).
        let response = inverse * t.transpose();
        covariance += &response * q.displacement_covariance() * response.transpose();
    }
    covariance
}

/// The own covariance plus that of the parents' motions, which shift the joint through the fit. See
/// docs/method.md (8.12).
fn total_covariance(
    own: &DMatrix<f64>,
    inverse: &DMatrix<f64>,
    fit: &JointFit,
    found: &FreeFits,
) -> DMatrix<f64> {
    let mut covariance = own.clone();
    for (k, (q, t)) in fit.quadratics.iter().zip(&fit.tangents).enumerate() {
        // A small motion of a parent moves the fitted surface by the same amount.
        let carried = inverse * t.transpose() * q.information;
        covariance += &carried * found.parent_motion(k).covariance * carried.transpose();
    }
    covariance
}

/// Changes of the parameters by drawn errors of poses and depth, per draw: through the part's own residuals
/// and through the parents' motions. See docs/method.md (8.13).
fn drawn_parameters(inverse: &DMatrix<f64>, fit: &JointFit, found: &FreeFits) -> Vec<DVector<f64>> {
    let mut drawn: Vec<DVector<f64>> = Vec::new();
    for (k, (q, t)) in fit.quadratics.iter().zip(&fit.tangents).enumerate() {
        let motion = fit.joint.world_motion(k, &found.parent_motion(k).state1_from_state0);
        let gradients = found.drawn_gradients(k, &motion, &q.information);
        drawn.resize(gradients.len().max(drawn.len()), DVector::zeros(inverse.nrows()));
        let response = inverse * t.transpose();
        drawn.iter_mut().zip(gradients).for_each(|(sum, gradient)| *sum -= &response * gradient);
    }
    drawn
}

/// Factor by which errors of state 0, common to all motions, increase the squared error of the axis: the
/// cluster-robust variance with the blocks of state 0 joined across motions, over that with every motion's
/// blocks apart. At least 1, and 1 for a single motion. See docs/method.md (8.11).
fn shared_error(fit: &JointFit) -> f64 {
    let Some(inverse) = &fit.inverse else { return 1.0 };
    let [joined, apart] = [true, false].map(|joined| -> f64 {
        let robust = inverse * block_scatter(fit, joined) * inverse;
        // Relative variances: radians and meters can be added.
        (0..fit.joint.axis_dimension()).map(|i| robust[(i, i)] / inverse[(i, i)]).sum()
    });
    if apart > 0.0 { (joined / apart).max(1.0) } else { 1.0 }
}

/// Sum of the squared gradients of all blocks, in the joint's parameters.
fn block_scatter(fit: &JointFit, joined: bool) -> DMatrix<f64> {
    let n = fit.joint.dimension();
    let mut gradients = BTreeMap::new();
    for (k, (q, t)) in fit.quadratics.iter().zip(&fit.tangents).enumerate() {
        for (block, gradient) in &q.block_gradients {
            // The surface of the other state belongs to one motion only.
            let motion = if joined && block.source != Source::Surface1 { 0 } else { k };
            *gradients.entry((*block, motion)).or_insert_with(|| DVector::zeros(n)) +=
                t.transpose() * gradient;
        }
    }
    let mut sum = DMatrix::zeros(n, n);
    gradients.values().for_each(|g| sum += g * g.transpose());
    sum
}

#[cfg(test)]
#[path = "joint_covariance_tests.rs"]
mod tests;
