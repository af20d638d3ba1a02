//! One joint for the motions of a part to all states: the axis is shared, every state has a position of its own.
//!
//! The parameters are those of the axis (direction 2; point 2 where it turns; pitch 1 of a screw) and one position a motion.
//! Information matrices of all motions add up in them. All motions start at the surface of state 0, whose errors run through
//! all of them: the dispersion counts its blocks across motions, so that a further state narrows the axis by what it adds.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector, Matrix6, Point3, SMatrix, Unit, Vector3, Vector6};

use super::{
    joint::{
        Cautioned, DECISIVE, JointEstimate, PARAMETERS, ParentMotion, among, cautions, directed, excess, far, fit_free, not_observable,
    },
    joint_motion::{RevoluteMotion, foot, frame_across},
    motion_fit::{FreeMotion, MotionEvidence, MotionModel, Quadratic, RefineConfig, Refined, minimise},
};
use crate::{
    geometry::{Pose, Screw, log_so3},
    model::{JointEvidence, JointKind},
};

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

/// A motion is left out where that leaves less than this share of what no joint explains.
const OUTLIER_SHARE: f64 = 0.2;

/// Freedom of a joint.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Freedom {
    Slide,
    Turn,
    Helix,
}

/// A joint and its position in each state behind state 0.
#[derive(Clone, Debug)]
struct SharedJoint {
    freedom: Freedom,
    direction: Unit<Vector3<f64>>,
    point: Point3<f64>,
    pitch_m_per_rad: f64,
    positions: Vec<f64>,
}

impl SharedJoint {
    /// Number of parameters of the axis.
    fn shared(&self) -> usize {
        match self.freedom {
            Freedom::Slide => 2,
            Freedom::Turn => 4,
            Freedom::Helix => 5,
        }
    }

    fn dimension(&self) -> usize {
        self.shared() + self.positions.len()
    }

    fn stepped(&self, s: &DVector<f64>) -> Self {
        let (a, b) = frame_across(&self.direction);
        let mut next = self.clone();
        next.direction = Unit::new_normalize(self.direction.into_inner() + a * s[0] + b * s[1]);
        if self.freedom != Freedom::Slide {
            next.point = self.point + a * s[2] + b * s[3];
        }
        if self.freedom == Freedom::Helix {
            next.pitch_m_per_rad += s[4];
        }
        next.positions.iter_mut().enumerate().for_each(|(k, q)| *q += s[self.shared() + k]);
        next
    }

    /// Motion relative to the parent at a position.
    fn at(&self, position: f64) -> Pose {
        let (angle_rad, advance_m) = match self.freedom {
            Freedom::Slide => (0.0, position),
            Freedom::Turn => (position, 0.0),
            Freedom::Helix => (position, self.pitch_m_per_rad * position),
        };
        Screw { direction: self.direction, point: self.point, angle_rad: 0.0, advance_m: 0.0 }.motion_by(angle_rad, advance_m)
    }

    /// The position that comes nearest to a motion relative to the parent.
    fn nearest(&self, relative: &Pose, near: &Point3<f64>) -> f64 {
        match self.freedom {
            Freedom::Slide => self.direction.dot(&(relative * near - near)),
            Freedom::Turn | Freedom::Helix => log_so3(&relative.rotation).dot(&self.direction),
        }
    }

    /// Left perturbation of motion `k` in the world per unit of each parameter, 6 x dimension.
    fn tangent(&self, k: usize, parent: &Pose) -> DMatrix<f64> {
        AtMotion { joint: self.clone(), k, parent: *parent }.tangent()
    }
}

/// A shared joint as a family of one of its motions.
struct AtMotion {
    joint: SharedJoint,
    k: usize,
    parent: Pose,
}

impl MotionModel for AtMotion {
    fn dimension(&self) -> usize {
        self.joint.dimension()
    }

    fn stepped(&self, step: &DVector<f64>) -> Self {
        Self { joint: self.joint.stepped(step), k: self.k, parent: self.parent }
    }

    fn motion(&self) -> Pose {
        self.parent * self.joint.at(self.joint.positions[self.k])
    }
}

/// A joint fitted to some motions.
struct Fitted {
    joint: SharedJoint,
    quadratics: Vec<Quadratic>,
    tangents: Vec<DMatrix<f64>>,
    covariance: Option<DMatrix<f64>>,
}

impl Fitted {
    fn cost(&self) -> f64 {
        self.quadratics.iter().map(|q| q.cost).sum()
    }
}

/// All motions with what a free fit makes of each.
struct Motions<'a> {
    all: &'a [JointMotion<'a>],
    free: Vec<Refined<FreeMotion>>,
    dispersion: f64,
    count: f64,
    near: Point3<f64>,
    radius_m: f64,
    config: &'a RefineConfig,
}

impl<'a> Motions<'a> {
    fn new(all: &'a [JointMotion<'a>], (near, radius_m): (&Point3<f64>, f64), config: &'a RefineConfig) -> Self {
        let (free, dispersions): (Vec<_>, Vec<f64>) = all.iter().map(|m| fit_free(&m.start, &m.evidence, config)).unzip();
        let independent: f64 = free.iter().map(|f| f.quadratic.independent.max(2.0)).sum();
        let weighed = free.iter().zip(&dispersions).map(|(f, d)| f.quadratic.independent.max(2.0) * d);
        let dispersion = weighed.sum::<f64>() / independent;
        Self { all, free, dispersion, count: (independent / dispersion).max(2.0), near: *near, radius_m, config }
    }

    /// Motion `k` relative to the parent, without a joint.
    fn relative(&self, k: usize) -> Pose {
        self.all[k].parent.state1_from_state0.inverse() * self.free[k].model.motion()
    }

    fn linearised(&self, joint: &SharedJoint) -> Vec<Quadratic> {
        let at = |k: usize| self.all[k].parent.state1_from_state0 * joint.at(joint.positions[k]);
        (0..self.all.len()).map(|k| self.all[k].evidence.linearise(&at(k), self.free[k].sigma_m, self.config)).collect()
    }

    /// All motions at once.
    fn fit(&self, start: SharedJoint) -> Fitted {
        let cost = |all: &Vec<Quadratic>| all.iter().map(|q| q.cost).sum::<f64>();
        let equations = |joint: &SharedJoint, all: &Vec<Quadratic>| self.normal_equations(joint, all);
        let (joint, quadratics) =
            minimise(start, self.config.iterations, |joint| self.linearised(joint), cost, equations, SharedJoint::stepped);
        let (h, _) = self.normal_equations(&joint, &quadratics);
        let tangents = (0..self.all.len()).map(|k| joint.tangent(k, &self.all[k].parent.state1_from_state0)).collect();
        Fitted { joint, quadratics, tangents, covariance: h.cholesky().map(|c| c.inverse()) }
    }

    /// Information and half the gradient of all motions in the joint's parameters.
    fn normal_equations(&self, joint: &SharedJoint, quadratics: &[Quadratic]) -> (DMatrix<f64>, DVector<f64>) {
        let n = joint.dimension();
        let (mut h, mut g) = (DMatrix::zeros(n, n), DVector::zeros(n));
        for (k, q) in quadratics.iter().enumerate() {
            let t = joint.tangent(k, &self.all[k].parent.state1_from_state0);
            h += t.transpose() * q.information * &t;
            g += t.transpose() * q.gradient;
        }
        (h, g)
    }

    /// Every joint type, started at the motion whose joint suits all motions best: the largest tells the axis most sharply, but
    /// one that is wrong may be the largest.
    fn fits(&self) -> Vec<Fitted> {
        let slide = |k: usize| SharedJoint {
            freedom: Freedom::Slide,
            direction: Unit::try_new(self.relative(k) * self.near - self.near, 1e-9).unwrap_or_else(Vector3::x_axis),
            point: self.near,
            pitch_m_per_rad: 0.0,
            positions: Vec::new(),
        };
        let turn = |k: usize| {
            let r = RevoluteMotion::of(&self.relative(k), &self.near)?;
            Some(SharedJoint { freedom: Freedom::Turn, direction: r.direction, point: r.point, ..slide(k) })
        };
        let helix = |k: usize| {
            let pitch_m_per_rad = Screw::of(&self.relative(k)).map_or(0.0, |s| s.advance_m / s.angle_rad);
            turn(k).map(|t| SharedJoint { freedom: Freedom::Helix, pitch_m_per_rad, ..t })
        };
        let all = 0..self.all.len();
        let starts = [all.clone().map(slide).collect(), all.clone().filter_map(turn).collect(), all.filter_map(helix).collect()];
        starts.into_iter().filter_map(|s: Vec<SharedJoint>| self.best_start(s)).map(|joint| self.fit(joint)).collect()
    }

    /// Of some joints the one of the lowest cost, with the position that comes nearest to each motion.
    fn best_start(&self, joints: Vec<SharedJoint>) -> Option<SharedJoint> {
        let placed = joints.into_iter().map(|mut joint| {
            joint.positions = (0..self.all.len()).map(|k| joint.nearest(&self.relative(k), &self.near)).collect();
            (self.linearised(&joint).iter().map(|q| q.cost).sum::<f64>(), joint)
        });
        placed.reduce(|a, b| if b.0 < a.0 { b } else { a }).map(|(_, joint)| joint)
    }

    /// Bayesian information criterion in units of the errors that were seen.
    fn score(&self, cost: f64, parameters: f64) -> f64 {
        cost / self.dispersion + parameters * self.count.ln()
    }

    fn scores(&self, fits: &[Fitted]) -> BTreeMap<String, f64> {
        let still =
            |k: usize| self.all[k].evidence.linearise(&self.all[k].parent.state1_from_state0, self.free[k].sigma_m, self.config).cost;
        let motions = self.all.len();
        let free: f64 = self.free.iter().map(|f| f.quadratic.cost).sum();
        let mut scores = BTreeMap::from([
            ("fixed".to_owned(), self.score((0..motions).map(still).sum(), 0.0)),
            ("free".to_owned(), self.score(free, PARAMETERS[2] * motions as f64)),
        ]);
        for fit in fits {
            let joint = &fit.joint;
            let turn = RevoluteMotion { direction: joint.direction, point: joint.point, angle_rad: 0.0 };
            let (name, off) = match joint.freedom {
                Freedom::Slide => ("prismatic", 0.0),
                Freedom::Turn => ("revolute", far(&turn, &self.near, self.radius_m)),
                Freedom::Helix => ("screw", far(&turn, &self.near, self.radius_m)),
            };
            scores.insert(name.to_owned(), self.score(fit.cost(), joint.dimension() as f64) + off);
        }
        scores
    }

    /// Squared error of the axis against what independent residuals give: blocks of the surface and of the matches, those of
    /// state 0 across all motions.
    fn dispersion_of(&self, fit: &Fitted) -> f64 {
        let Some(covariance) = &fit.covariance else { return self.dispersion };
        let n = fit.joint.dimension();
        let mut blocks: BTreeMap<[i64; 4], DVector<f64>> = BTreeMap::new();
        for (k, (q, t)) in fit.quadratics.iter().zip(&fit.tangents).enumerate() {
            for (block, gradient) in &q.block_gradients {
                // Kind 1 is the surface of the other state, which no other motion shares.
                let key = if block[3] == 1 { [block[0], block[1], block[2], 3 + k as i64] } else { *block };
                let gradient: &Vector6<f64> = gradient;
                *blocks.entry(key).or_insert_with(|| DVector::zeros(n)) += t.transpose() * gradient;
            }
        }
        if blocks.len() <= n {
            return self.dispersion;
        }
        let mut spread = DMatrix::zeros(n, n);
        blocks.values().for_each(|g| spread += g * g.transpose());
        let robust = covariance * spread * covariance;
        let shared = fit.joint.shared();
        let ratio = (0..shared).map(|i| robust[(i, i)] / covariance[(i, i)]).sum::<f64>() / shared as f64;
        let small_sample = blocks.len() as f64 / (blocks.len() - n) as f64;
        self.dispersion.max(small_sample * ratio)
    }
}

/// Fits all joint types to all motions of a part and chooses. `near` is the middle of the part in state 0 and `radius_m` the
/// distance of its farthest point from there. Where a `doubt` is allowed and no joint explains all motions, the one whose
/// absence lets the others agree is left out of the axis, which is told.
///
/// The motions must share the side of their blocks ([`MotionEvidence::block_m`]).
#[must_use]
pub fn estimate_shared_joint(
    motions: &[JointMotion],
    place: (&Point3<f64>, f64),
    doubt: bool,
    kind: Option<JointKind>,
    config: &RefineConfig,
) -> JointEstimate {
    let found = Motions::new(motions, place, config);
    let fits = found.fits();
    let scores = found.scores(&fits);
    if doubt && motions.len() > 1 && excess(&scores, true) > DECISIVE {
        let without = |left_out: usize| {
            let others: Vec<JointMotion> = motions.iter().enumerate().filter(|(k, _)| *k != left_out).map(|(_, m)| *m).collect();
            let excess = {
                let found = Motions::new(&others, place, config);
                excess(&found.scores(&found.fits()), true)
            };
            (excess, left_out, others)
        };
        let best = (0..motions.len()).map(without).reduce(|a, b| if b.0 < a.0 { b } else { a });
        if let Some((_, left_out, others)) = best.filter(|b| b.0 < DECISIVE.max(OUTLIER_SHARE * excess(&scores, true))) {
            let estimate = estimate_shared_joint(&others, place, false, kind, config);
            return with_contradiction(estimate, &found, left_out);
        }
    }
    estimate(&found, fits, scores, kind)
}

/// The estimate with a position for the motion that it leaves out, and what that motion needs beyond the joint.
fn with_contradiction(mut estimate: JointEstimate, found: &Motions, left_out: usize) -> JointEstimate {
    let freedom = match estimate.kind {
        JointKind::Prismatic => Freedom::Slide,
        JointKind::Revolute => Freedom::Turn,
        JointKind::Screw { .. } | JointKind::Free { .. } => Freedom::Helix,
    };
    let mut joint = SharedJoint {
        freedom,
        direction: estimate.axis,
        point: estimate.point,
        pitch_m_per_rad: estimate.kind.pitch_m_per_rad().unwrap_or_default(),
        positions: Vec::new(),
    };
    let (relative, parent) = (found.relative(left_out), &found.all[left_out].parent);
    let q = joint.nearest(&relative, &found.near);
    joint.positions = vec![q];
    let pose = parent.state1_from_state0 * joint.at(q);
    let off = pose.inverse() * found.free[left_out].model.motion();
    estimate.evidence.cautions.push(format!(
        "state {} contradicts the other states: there the part is {:.1} mm and {:.1} deg off the joint that they show; it is left out of \
         the axis",
        left_out + 1,
        1e3 * (off * found.near - found.near).norm(),
        off.rotation.angle().to_degrees()
    ));
    estimate.positions.insert(left_out, q);
    estimate.motions.insert(left_out, pose);
    estimate.covariances.insert(left_out, parent.covariance);
    estimate.evidence.position_std.insert(left_out, f64::INFINITY);
    estimate
}

/// The type of the lowest score, a screw only decisively, unless the kind is known.
fn choose(scores: &BTreeMap<String, f64>, kind: Option<JointKind>) -> Freedom {
    let of = |name: &str| among(kind, scores, name);
    if of("screw") + DECISIVE < of("prismatic").min(of("revolute")) {
        Freedom::Helix
    } else if of("revolute") < of("prismatic") {
        Freedom::Turn
    } else {
        Freedom::Slide
    }
}

/// The joint of the best type.
fn estimate(found: &Motions, mut fits: Vec<Fitted>, scores: BTreeMap<String, f64>, kind: Option<JointKind>) -> JointEstimate {
    let chosen = choose(&scores, kind);
    let index = fits.iter().position(|f| f.joint.freedom == chosen).unwrap_or(0);
    let fit = fits.swap_remove(index);
    let joint = &fit.joint;
    let point = foot(&joint.point, &joint.direction, &found.near);
    let kind = match joint.freedom {
        Freedom::Slide => JointKind::Prismatic,
        Freedom::Turn => JointKind::Revolute,
        // The thread is on the part: a screw line beside it is that of a free motion.
        Freedom::Helix if (point - found.near).norm() < found.radius_m => JointKind::Screw { pitch_m_per_rad: joint.pitch_m_per_rad },
        Freedom::Helix => JointKind::Free { pitch_m_per_rad: joint.pitch_m_per_rad },
    };
    let farthest = (0..joint.positions.len())
        .max_by(|a, b| joint.positions[*a].abs().total_cmp(&joint.positions[*b].abs()).then(b.cmp(a)))
        .unwrap_or(0);
    let dispersion = found.dispersion_of(&fit);
    let covariance = fit.covariance.as_ref().map(|c| total_covariance(c, &fit, found, dispersion));
    let forward = joint.positions[farthest] >= 0.0;
    let full = covariance.as_ref().map_or_else(|| SMatrix::from_element(f64::INFINITY), |c| directed(spread(joint, farthest, c), forward));
    let shared = joint.shared();
    let std = |k: usize| covariance.as_ref().map_or(f64::INFINITY, |c| c[(shared + k, shared + k)].max(0.0).sqrt());
    let position_std = (0..joint.positions.len()).map(std).collect();
    let own = |k: usize| -> Matrix6<f64> {
        let t = &fit.tangents[k];
        let own = fit.covariance.as_ref().map(|c| t * own_covariance(c, &fit, dispersion) * t.transpose());
        own.map_or_else(Matrix6::zeros, |c| Matrix6::from_fn(|r, k| c[(r, k)]))
    };
    let covariances = (0..joint.positions.len()).map(|k| own(k) + found.all[k].parent.covariance).collect();
    let motions = (0..joint.positions.len()).map(|k| found.all[k].parent.state1_from_state0 * joint.at(joint.positions[k])).collect();
    let sign = if forward { 1.0 } else { -1.0 };
    let axis = if forward { joint.direction } else { -joint.direction };
    let agreement = fit.quadratics.iter().fold([0, 0], |[a, b], q| [a + q.inliers, b + q.tried]);
    let squared_m2: f64 = fit.quadratics.iter().map(|q| q.squared_m2).sum();
    let readings: usize = fit.quadratics.iter().map(|q| q.surface_inliers).sum();
    let said = Cautioned { kind, motion: joint.positions[farthest].abs(), scores: &scores, agreement };
    let evidence = JointEvidence {
        covariance: full.fixed_view::<7, 7>(0, 0).into(),
        position_std,
        pitch_std_m_per_rad: if kind.pitch_m_per_rad().is_some() { full[(7, 7)].max(0.0).sqrt() } else { 0.0 },
        state1_from_state0: found.free[farthest].model.motion(),
        inliers: agreement[0],
        tried: agreement[1],
        residual_rms_m: (squared_m2 / readings.max(1) as f64).sqrt(),
        dispersion,
        axis_alone: None,
        cautions: cautions(&said),
        type_scores: scores,
        parents: BTreeMap::new(),
        not_observable: not_observable(kind, joint.positions.len() + 1),
    };
    JointEstimate {
        kind,
        axis,
        point: foot(&joint.point, &axis, &found.near),
        positions: joint.positions.iter().map(|q| sign * q).collect(),
        motions,
        covariances,
        evidence,
    }
}

/// Covariance of the parameters by what the fit rests on: residuals, and displacements of the surfaces.
fn own_covariance(covariance: &DMatrix<f64>, fit: &Fitted, dispersion: f64) -> DMatrix<f64> {
    let mut total = covariance * dispersion;
    for (q, t) in fit.quadratics.iter().zip(&fit.tangents) {
        let response = covariance * t.transpose();
        total += &response * q.displacements() * response.transpose();
    }
    total
}

/// Covariance of the parameters: that of the fit, and that of the parents' motions, which shift the joint by what the fit
/// makes of them.
fn total_covariance(covariance: &DMatrix<f64>, fit: &Fitted, found: &Motions, dispersion: f64) -> DMatrix<f64> {
    let mut total = own_covariance(covariance, fit, dispersion);
    for (k, (q, t)) in fit.quadratics.iter().zip(&fit.tangents).enumerate() {
        let carried = covariance * t.transpose() * q.information;
        total += &carried * found.all[k].parent.covariance * carried.transpose();
    }
    total
}

/// Covariance of (direction 3, point 3, motion 1, pitch 1) from that of the parameters; the motion is number `farthest`.
fn spread(joint: &SharedJoint, farthest: usize, covariance: &DMatrix<f64>) -> SMatrix<f64, 8, 8> {
    let (a, b) = frame_across(&joint.direction);
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
    to[(6, joint.shared() + farthest)] = 1.0;
    let full = &to * covariance * to.transpose();
    SMatrix::from_fn(|r, c| full[(r, c)])
}

#[cfg(test)]
#[path = "joint_states_tests.rs"]
mod tests;
