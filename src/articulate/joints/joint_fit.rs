//! The fit of one joint to the motions of a part to all other states.
//!
//! Information matrices of all motions add up in the parameters of the joint.

use nalgebra::{DMatrix, DVector, Matrix6, Point3, Vector6};

use crate::joints::{
    free_motion::{FreeFit, ParentMotion},
    joint_motion::PlacedJoint,
    minimise::minimise,
    motion_evidence::{MotionEvidence, RefineConfig},
    quadratic::Quadratic,
};
use geometry::Pose;

/// What is known of one motion of a part, from state 0 to another state.
#[derive(Clone, Copy)]
pub struct JointMotion<'a> {
    /// Motion of the part that the fit starts from, in the world.
    pub start: Pose,
    /// Motion of the parent.
    pub parent: &'a ParentMotion,
    /// What both states show.
    pub evidence: MotionEvidence<'a>,
}

/// Where a part is in state 0.
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

/// Residuals of a joint: the motions, the standard deviation of the surface residuals of each.
pub(crate) struct Residuals<'a> {
    pub motions: &'a [JointMotion<'a>],
    pub sigma_m: Vec<f64>,
    pub config: &'a RefineConfig,
}

impl Residuals<'_> {
    /// Quadratic models of the costs of all motions at what `motion` makes each of them.
    pub(crate) fn at(&self, motion: impl Fn(usize) -> Pose) -> Vec<Quadratic> {
        let linearise =
            |k: usize| self.motions[k].evidence.linearise(&motion(k), self.sigma_m[k], self.config);
        (0..self.motions.len()).map(linearise).collect()
    }

    fn at_joint(&self, joint: &PlacedJoint) -> Vec<Quadratic> {
        self.at(|k| joint.motion(k, &self.motions[k].parent.state1_from_state0))
    }

    /// The joint of the lowest cost near a start; the first `held` of its parameters stay.
    pub(crate) fn fit(&self, start: PlacedJoint, held: usize) -> JointFit {
        // What is held has no column: the others move to where they suit it best.
        let equations = |joint: &PlacedJoint, all: &Vec<Quadratic>| {
            let (h, g) = normal_equations(&self.tangents(joint), all);
            (h.remove_rows(0, held).remove_columns(0, held), g.remove_rows(0, held))
        };
        let (joint, quadratics) = minimise(
            start,
            self.config.iterations,
            |joint| self.at_joint(joint),
            |all| all.iter().map(|q| q.cost).sum(),
            equations,
            |joint, step| joint.stepped(&step.clone().insert_rows(0, held, 0.0)),
        );
        // The covariance is that of all parameters, also of those that were held.
        let tangents = self.tangents(&joint);
        let (h, _) = normal_equations(&tangents, &quadratics);
        JointFit { joint, quadratics, tangents, inverse: h.cholesky().map(|c| c.inverse()) }
    }

    fn tangents(&self, joint: &PlacedJoint) -> Vec<DMatrix<f64>> {
        let of = |(k, m): (usize, &JointMotion)| joint.tangent(k, &m.parent.state1_from_state0);
        self.motions.iter().enumerate().map(of).collect()
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

/// All motions of a part with what a free fit makes of each.
pub(crate) struct FreeFits<'a> {
    pub residuals: Residuals<'a>,
    pub free: Vec<FreeFit>,
    /// Squared error of the motions against what independent residuals give, a mean by their number.
    pub dispersion: f64,
    /// Independent residuals after that.
    pub count: f64,
    pub place: PartPlace,
}

impl<'a> FreeFits<'a> {
    pub(crate) fn new(motions: &'a [JointMotion<'a>], place: PartPlace, config: &'a RefineConfig) -> Self {
        let free: Vec<FreeFit> =
            motions.iter().map(|m| FreeFit::new(&m.start, &m.evidence, config)).collect();
        // A motion that more residuals bear out says more about their errors.
        let independent: f64 = free.iter().map(FreeFit::independent).sum();
        let weighed: f64 = free.iter().map(|f| f.independent() * f.dispersion).sum();
        let dispersion = weighed / independent;
        // All types are judged by one scale, that of the free motion, or the worst fit would forgive itself.
        let sigma_m = free.iter().map(|f| f.sigma_m).collect();
        let residuals = Residuals { motions, sigma_m, config };
        // At least two readings: with one, whose logarithm is 0, parameters would cost nothing.
        Self { residuals, free, dispersion, count: (independent / dispersion).max(2.0), place }
    }

    /// Motion `k` of the parent.
    pub(crate) fn parent(&self, k: usize) -> &ParentMotion {
        self.residuals.motions[k].parent
    }

    /// Motion `k` relative to the parent, without a joint.
    pub(crate) fn relative(&self, k: usize) -> Pose {
        self.parent(k).state1_from_state0.inverse() * self.free[k].motion
    }

    /// What errors of poses and depth add to half the gradient of motion `k`, by draw: by the part's own
    /// residuals, and by the motion of its parent, which the `information` makes a gradient.
    pub(crate) fn drawn(&self, k: usize, motion: &Pose, information: &Matrix6<f64>) -> Vec<Vector6<f64>> {
        let Residuals { motions, sigma_m, config } = &self.residuals;
        let own = motions[k].evidence.drawn(motion, sigma_m[k], config);
        let of_parent = |draw| information * self.parent(k).drawn(draw);
        own.into_iter().enumerate().map(|(draw, g)| g + of_parent(draw)).collect()
    }

    /// The slide that explains all motions best.
    pub(crate) fn slide(&self) -> JointFit {
        let slide = |k| PlacedJoint::slide(&self.relative(k), &self.place.middle);
        self.fit((0..self.free.len()).map(slide).collect())
    }

    /// The turn about one axis that explains all motions best; `None` where none of them turns.
    pub(crate) fn turn(&self) -> Option<JointFit> {
        let turn = |k| PlacedJoint::turn(&self.relative(k), &self.place.middle);
        let starts: Vec<PlacedJoint> = (0..self.free.len()).filter_map(turn).collect();
        (!starts.is_empty()).then(|| self.fit(starts))
    }

    /// The screw that explains all motions best; `None` where none of them turns.
    pub(crate) fn helix(&self) -> Option<JointFit> {
        let helix = |k| PlacedJoint::helix(&self.relative(k), &self.place.middle);
        let starts: Vec<PlacedJoint> = (0..self.free.len()).filter_map(helix).collect();
        (!starts.is_empty()).then(|| self.fit(starts))
    }

    /// The joint that starts at the best of some, with the positions that come nearest to the motions: the
    /// largest motion shows the axis most sharply, but one that is wrong may be the largest.
    fn fit(&self, starts: Vec<PlacedJoint>) -> JointFit {
        let position = |joint: &PlacedJoint, k: usize| joint.nearest(&self.relative(k), &self.place.middle);
        let mut starts: Vec<(f64, PlacedJoint)> = starts
            .into_iter()
            .map(|mut joint| {
                joint.positions = (0..self.free.len()).map(|k| position(&joint, k)).collect();
                (self.residuals.at_joint(&joint).iter().map(|q| q.cost).sum::<f64>(), joint)
            })
            .collect();
        let best = (1..starts.len()).fold(0, |a, b| if starts[b].0 < starts[a].0 { b } else { a });
        self.residuals.fit(starts.swap_remove(best).1, 0)
    }
}

#[cfg(test)]
#[path = "joint_fit_tests.rs"]
pub(super) mod tests;
