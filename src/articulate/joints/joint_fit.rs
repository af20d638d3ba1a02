//! Fits one joint to the motions of a part to all other states.
//!
//! The information matrices of all motions add up in the parameters of the joint.

use nalgebra::{DMatrix, DVector, Matrix6, Point3, Vector6};

use crate::joints::{
    free_motion::{FreeFit, ITERATIONS, ParentMotion},
    joint_motion::PlacedJoint,
    minimise::minimise,
    motion_evidence::MotionEvidence,
    quadratic::Quadratic,
};
use geometry::Pose;

/// The evidence for one motion of a part, from state 0 to another state.
#[derive(Clone, Copy)]
pub struct JointMotion<'a> {
    /// Motion of the part at the start of the fit, in the world.
    pub start: Pose,
    /// Motion of the parent.
    pub parent: &'a ParentMotion,
    /// Evidence of both states.
    pub evidence: MotionEvidence<'a>,
}

/// Position and size of a part in state 0.
#[derive(Clone, Copy, Debug)]
pub struct PartPlace {
    /// Middle of its surface.
    pub middle: Point3<f64>,
    /// Distance of its farthest point from there, meters.
    pub radius_m: f64,
}

/// A joint fitted to some motions.
pub(crate) struct JointFit {
    pub joint: PlacedJoint,
    /// Quadratic model of the cost of each motion.
    pub quadratics: Vec<Quadratic>,
    /// Left perturbations of each motion by the parameters, 6 x dimension.
    pub tangents: Vec<DMatrix<f64>>,
    /// Inverse information of the parameters; `None` where some direction is not observed.
    pub inverse: Option<DMatrix<f64>>,
}

impl JointFit {
    /// Cost of all motions.
    pub(crate) fn cost(&self) -> f64 {
        self.quadratics.iter().map(|q| q.cost).sum()
    }
}

/// What the residuals of a joint depend on: the motions, and the standard deviation of each motion's surface
/// residuals.
pub(crate) struct Residuals<'a> {
    pub motions: &'a [JointMotion<'a>],
    pub sigma_m: Vec<f64>,
}

impl Residuals<'_> {
    /// Quadratic models of the costs of all motions, each at pose `motion(k)`.
    pub(crate) fn models_at(&self, motion: impl Fn(usize) -> Pose) -> Vec<Quadratic> {
        let numbered = self.motions.iter().enumerate();
        numbered.map(|(k, m)| m.evidence.linearise(&motion(k), self.sigma_m[k])).collect()
    }

    fn at_joint(&self, joint: &PlacedJoint) -> Vec<Quadratic> {
        self.models_at(|k| joint.world_motion(k, &self.motions[k].parent.state1_from_state0))
    }

    /// The joint of lowest cost near a start; the first `held` of its parameters stay fixed.
    pub(crate) fn fitted_joint(&self, start: PlacedJoint, held: usize) -> JointFit {
        let (joint, quadratics) = minimise(
            start,
            ITERATIONS,
            |joint| self.at_joint(joint),
            |all| all.iter().map(|q| q.cost).sum(),
            |joint, all| {
                let (h, g) = normal_equations(&self.motion_tangents(joint), all);
                // A held parameter has no column: the others are fitted to it.
                (h.remove_rows(0, held).remove_columns(0, held), g.remove_rows(0, held))
            },
            |joint, step| joint.stepped(&step.clone().insert_rows(0, held, 0.0)),
        );
        // The covariance covers all parameters, also the held ones.
        let tangents = self.motion_tangents(&joint);
        let (h, _) = normal_equations(&tangents, &quadratics);
        JointFit { joint, quadratics, tangents, inverse: h.cholesky().map(|c| c.inverse()) }
    }

    fn motion_tangents(&self, joint: &PlacedJoint) -> Vec<DMatrix<f64>> {
        let numbered = self.motions.iter().enumerate();
        numbered.map(|(k, m)| joint.motion_tangent(k, &m.parent.state1_from_state0)).collect()
    }
}

/// Information and half the gradient of all motions in the joint's parameters. See docs/method.md (8.8).
fn normal_equations(tangents: &[DMatrix<f64>], quadratics: &[Quadratic]) -> (DMatrix<f64>, DVector<f64>) {
    let n = tangents.first().map_or(0, DMatrix::ncols);
    let mut h = DMatrix::zeros(n, n);
    let mut g = DVector::zeros(n);
    for (t, q) in tangents.iter().zip(quadratics) {
        h += t.transpose() * q.information * t;
        g += t.transpose() * q.gradient;
    }
    (h, g)
}

/// All motions of a part, each with its free fit.
pub(crate) struct FreeFits<'a> {
    pub residuals: Residuals<'a>,
    pub free: Vec<FreeFit>,
    /// Ratio of the squared error of the motions to that expected of independent residuals, averaged by their
    /// number.
    pub dispersion: f64,
    /// Number of independent residuals, divided by the dispersion.
    pub count: f64,
    pub place: PartPlace,
}

impl<'a> FreeFits<'a> {
    pub(crate) fn new(motions: &'a [JointMotion<'a>], place: PartPlace) -> Self {
        let free: Vec<FreeFit> = motions.iter().map(|m| FreeFit::new(&m.start, &m.evidence)).collect();
        // A motion with more residuals shows more of their errors.
        let independent: f64 = free.iter().map(FreeFit::independent_residuals).sum();
        let weighed: f64 = free.iter().map(|f| f.independent_residuals() * f.dispersion).sum();
        let dispersion = weighed / independent;
        // All types are judged by one scale, the free motions': by its own, the worst fit would excuse
        // itself.
        let sigma_m = free.iter().map(|f| f.sigma_m).collect();
        let residuals = Residuals { motions, sigma_m };
        // At least two: the logarithm of one is 0, and parameters would cost nothing.
        Self { residuals, free, dispersion, count: (independent / dispersion).max(2.0), place }
    }

    /// Motion `k` of the parent.
    pub(crate) fn parent_motion(&self, k: usize) -> &ParentMotion {
        self.residuals.motions[k].parent
    }

    /// Motion `k` relative to the parent, without a joint.
    pub(crate) fn relative_motion(&self, k: usize) -> Pose {
        self.parent_motion(k).state1_from_state0.inverse() * self.free[k].motion
    }

    /// Change of half the gradient of motion `k` by drawn errors of poses and depth, per draw: through the
    /// part's own residuals, and through the motion of its parent, which `information` turns into a gradient.
    pub(crate) fn drawn_gradients(
        &self,
        k: usize,
        motion: &Pose,
        information: &Matrix6<f64>,
    ) -> Vec<Vector6<f64>> {
        let Residuals { motions, sigma_m } = &self.residuals;
        let own = motions[k].evidence.drawn_gradients(motion, sigma_m[k]).into_iter().enumerate();
        own.map(|(draw, g)| g + information * self.parent_motion(k).drawn_perturbation(draw)).collect()
    }

    /// All motions relative to the parent, without a joint.
    fn all_relative(&self) -> impl Iterator<Item = Pose> {
        (0..self.free.len()).map(|k| self.relative_motion(k))
    }

    /// The slide that fits all motions best.
    pub(crate) fn fitted_slide(&self) -> JointFit {
        self.fit_from_best(self.all_relative().map(|m| PlacedJoint::slide(&m, &self.place.middle)).collect())
    }

    /// The turn about one axis that fits all motions best; `None` where none of them turns.
    pub(crate) fn fitted_turn(&self) -> Option<JointFit> {
        let starts: Vec<PlacedJoint> =
            self.all_relative().filter_map(|m| PlacedJoint::turn(&m, &self.place.middle)).collect();
        (!starts.is_empty()).then(|| self.fit_from_best(starts))
    }

    /// The screw that fits all motions best; `None` where none of them turns.
    pub(crate) fn fitted_helix(&self) -> Option<JointFit> {
        let starts: Vec<PlacedJoint> =
            self.all_relative().filter_map(|m| PlacedJoint::helix(&m, &self.place.middle)).collect();
        (!starts.is_empty()).then(|| self.fit_from_best(starts))
    }

    /// The joint fitted from the best of some starts, each with the positions nearest to the motions. Several
    /// are tried because the largest motion shows the axis most sharply, but may be wrong.
    fn fit_from_best(&self, starts: Vec<PlacedJoint>) -> JointFit {
        let mut starts: Vec<(f64, PlacedJoint)> = starts
            .into_iter()
            .map(|mut joint| {
                joint.positions =
                    self.all_relative().map(|m| joint.nearest_position(&m, &self.place.middle)).collect();
                (self.residuals.at_joint(&joint).iter().map(|q| q.cost).sum::<f64>(), joint)
            })
            .collect();
        let best = (1..starts.len()).fold(0, |a, b| if starts[b].0 < starts[a].0 { b } else { a });
        self.residuals.fitted_joint(starts.swap_remove(best).1, 0)
    }
}

#[cfg(test)]
#[path = "joint_fit_tests.rs"]
pub(super) mod tests;
