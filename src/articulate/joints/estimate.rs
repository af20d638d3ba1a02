//! Estimates the one joint behind the motions of a part to all other states: type, axis and positions are
//! chosen by evidence.
//!
//! Two states are the case of one motion. The released evaluation of the published method takes the type from
//! the ground truth; nothing here does.

use std::collections::BTreeMap;

use crate::joints::{
    cautions::{JudgedJoint, cautions, not_observable},
    joint::JointEstimate,
    joint_covariance::JointCovariance,
    joint_fit::{FreeFits, JointFit, JointMotion, PartPlace},
    joint_motion::{Freedom, PlacedJoint, foot_on_line},
    joint_type::{DECISIVE, TypeFits, excess_over_free},
};
use model::{JointEvidence, JointKind, JointRemark, TypeScores};

/// A motion is left out if without it the excess is below this share of the excess with it.
///
/// tuned: tests/states.rs
const OUTLIER_SHARE: f64 = 0.2;

/// How a joint is estimated.
#[derive(Clone, Copy, Debug, Default)]
pub struct JointChoice {
    /// Whether a motion that contradicts the others may be left out of the axis.
    pub doubt: bool,
    /// The joint's kind, where it is known.
    pub kind: Option<JointKind>,
}

/// Fits all joint types to all motions of a part and chooses one. If `doubt` is allowed and no joint explains
/// all motions, the motion without which the others agree is left out of the axis, with a caution.
///
/// All motions must use blocks of the same side
/// ([`MotionEvidence::block_m`](super::motion_evidence::MotionEvidence::block_m)).
pub(crate) fn estimate_joint(
    motions: &[JointMotion],
    place: PartPlace,
    choice: JointChoice,
) -> JointEstimate {
    let found = FreeFits::new(motions, place);
    let types = TypeFits::new(&found);
    if choice.doubt
        && motions.len() > 1
        && let Some(left_out) = outlier_motion(motions, place, excess_over_free(&types.scores, true))
    {
        // At most one motion is left out: without `doubt` the call does not come here again.
        let others = motions_without(motions, left_out);
        let estimate = estimate_joint(&others, place, JointChoice { doubt: false, ..choice });
        return with_contradiction(estimate, &found, left_out);
    }
    let (fit, scores) = types.chosen_fit(choice.kind);
    estimate(&found, &fit, scores)
}

/// All motions but one.
fn motions_without<'a>(motions: &[JointMotion<'a>], left_out: usize) -> Vec<JointMotion<'a>> {
    motions.iter().enumerate().filter(|(k, _)| *k != left_out).map(|(_, m)| *m).collect()
}

/// The motion without which the others agree on a joint though all together do not (their excess is `all`).
fn outlier_motion(motions: &[JointMotion], place: PartPlace, all: f64) -> Option<usize> {
    // Where a joint explains all motions about as well as free motions do, there is nothing to doubt.
    if all <= DECISIVE {
        return None;
    }
    // The others agree best when the wrong motion is left out.
    let mut best: Option<(f64, usize)> = None;
    for k in 0..motions.len() {
        let others = motions_without(motions, k);
        let left = excess_over_free(&TypeFits::new(&FreeFits::new(&others, place)).scores, true);
        if best.is_none_or(|b| left < b.0) {
            best = Some((left, k));
        }
    }
    let (left, k) = best?;
    (left < DECISIVE.max(OUTLIER_SHARE * all)).then_some(k)
}

/// The estimate with a position for the motion left out of it, and a caution about this motion.
fn with_contradiction(mut estimate: JointEstimate, found: &FreeFits, left_out: usize) -> JointEstimate {
    let joint = estimate.placed_joint();
    let middle = &found.place.middle;
    let relative = found.relative_motion(left_out);
    let parent = found.parent_motion(left_out);
    let q = joint.nearest_position(&relative, middle);
    let pose = parent.state1_from_state0 * joint.motion_at(q);
    // In the coordinates of state 0, where the part's middle is known.
    let off = pose.inverse() * found.free[left_out].motion;
    estimate.evidence.cautions.push(JointRemark::StateContradicts {
        state: left_out + 1,
        off_m: (off * middle - middle).norm(),
        off_rad: off.rotation.angle(),
    });
    estimate.positions.insert(left_out, q);
    estimate.motions.insert(left_out, pose);
    estimate.covariances.insert(left_out, parent.covariance);
    estimate.drawn.insert(left_out, parent.drawn.clone());
    // Infinity marks a contradicting motion: `settled` leaves it out, too.
    estimate.evidence.position_std.insert(left_out, f64::INFINITY);
    estimate
}

/// The kind of a fitted joint.
fn kind_of(joint: &PlacedJoint, place: &PartPlace) -> JointKind {
    let pitch_m_per_rad = joint.pitch_m_per_rad;
    let off_m = (foot_on_line(&joint.point, &joint.direction, &place.middle) - place.middle).norm();
    match joint.freedom {
        Freedom::Slide => JointKind::Prismatic,
        Freedom::Turn => JointKind::Revolute,
        // A real thread is on the part: a screw axis beside the part comes from a free motion.
        Freedom::Helix if off_m < place.radius_m => JointKind::Screw { pitch_m_per_rad },
        Freedom::Helix => JointKind::Free { pitch_m_per_rad },
    }
}

/// The fitted joint with its evidence.
fn estimate(found: &FreeFits, fit: &JointFit, scores: TypeScores) -> JointEstimate {
    let joint = &fit.joint;
    let motions = 0..joint.positions.len();
    let kind = kind_of(joint, &found.place);
    let sizes: Vec<f64> = joint.positions.iter().map(|q| q.abs()).collect();
    let farthest = motions.clone().reduce(|a, b| if sizes[b] > sizes[a] { b } else { a }).unwrap_or(0);
    // The axis points so that the farthest position is positive.
    let sign = if joint.positions[farthest] >= 0.0 { 1.0 } else { -1.0 };
    let axis = if sign > 0.0 { joint.direction } else { -joint.direction };
    let covariance = JointCovariance::new(fit, found);
    let full = covariance.axis_covariance(farthest);
    let pitch_std_m_per_rad = kind.pitch_m_per_rad().map(|_| full[(7, 7)].max(0.0).sqrt());
    let agreement = fit.quadratics.iter().fold([0, 0], |[a, b], q| [a + q.inliers, b + q.tried]);
    let judged = JudgedJoint { kind, motion: sizes[farthest], scores: &scores, agreement };
    let evidence = JointEvidence {
        covariance: full.fixed_view::<7, 7>(0, 0).into(),
        position_std: motions.clone().map(|k| covariance.position_std(k)).collect(),
        pitch_std_m_per_rad: pitch_std_m_per_rad.unwrap_or(0.0),
        state1_from_state0: found.free[farthest].motion,
        inliers: agreement[0],
        tried: agreement[1],
        residual_rms_m: residual_rms_m(fit),
        dispersion: covariance.dispersion,
        axis_alone: None,
        cautions: cautions(&judged).into_iter().map(JointRemark::from).collect(),
        type_scores: scores,
        parents: BTreeMap::new(),
        not_observable: not_observable(kind, joint.positions.len() + 1)
            .into_iter()
            .map(JointRemark::from)
            .collect(),
    };
    JointEstimate {
        kind,
        axis,
        point: foot_on_line(&joint.point, &axis, &found.place.middle),
        positions: joint.positions.iter().map(|q| sign * q).collect(),
        motions: motions
            .clone()
            .map(|k| joint.world_motion(k, &found.parent_motion(k).state1_from_state0))
            .collect(),
        covariances: motions.clone().map(|k| covariance.motion_covariance(k)).collect(),
        drawn: motions.map(|k| covariance.drawn_motion(k)).collect(),
        evidence,
    }
}

/// Root mean square distance of the inlier surface points, meters.
fn residual_rms_m(fit: &JointFit) -> f64 {
    let squared_m2: f64 = fit.quadratics.iter().map(|q| q.squared_m2).sum();
    let points: usize = fit.quadratics.iter().map(|q| q.surface_inliers).sum();
    (squared_m2 / points.max(1) as f64).sqrt()
}

#[cfg(test)]
#[path = "estimate_unit_tests.rs"]
mod unit_tests;

#[cfg(test)]
#[path = "estimate_tests.rs"]
mod tests;
