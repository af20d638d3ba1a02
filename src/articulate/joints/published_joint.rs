//! The joint of a motion by the published method (Weng et al. 2024, supplement A.4): the angle decides the
//! type; axis and pivot are in closed form. Surfaces are not used and nothing is refitted: errors of the
//! joint are errors of the motion alone.

use std::collections::BTreeMap;

use nalgebra::{Matrix6, Point3, SMatrix, Unit, Vector3};

use crate::joints::{joint::JointEstimate, joint_motion::foot_on_line, kinematic_tree::TreeJointEstimate};
use common::note::{Note, NoteCode};
use geometry::{Pose, Screw};
use model::{JointEvidence, JointKind, TypeScores};

/// A motion that turns less than this is a slide, radians.
///
/// derived: the published 10 degrees
const LEAST_TURN_RAD: f64 = std::f64::consts::PI / 18.0;
/// Variance of an unknown value, radians squared or square meters.
///
/// chosen: far beyond the variance of a guess (docs/method.md 8.7), and finite: JSON holds it
const UNKNOWN: f64 = 1e12;

/// The joint to the static part for a motion `state1_from_state0` in the world of a part around `middle`,
/// meters. Its standard deviations are not determined.
pub fn published_joint(state1_from_state0: &Pose, middle: &Point3<f64>) -> TreeJointEstimate {
    let turn = Screw::of_motion(state1_from_state0).filter(|s| s.angle_rad >= LEAST_TURN_RAD);
    let shift = state1_from_state0.translation.vector;
    let (kind, axis, point, position, motion) = match turn {
        // The pivot is the least squares solution of p = R p + t: the advance along the axis is ignored.
        Some(s) => {
            let point = foot_on_line(&s.point, &s.direction, middle);
            (JointKind::Revolute, s.direction, point, s.angle_rad, s.motion_by(s.angle_rad, 0.0))
        }
        None => {
            let axis = Unit::try_new(shift, 0.0).unwrap_or(Vector3::x_axis());
            let slide = Pose::from_parts(shift.into(), nalgebra::UnitQuaternion::identity());
            (JointKind::Prismatic, axis, *middle, shift.norm(), slide)
        }
    };
    let text = "type, axis and position are read off the motion alone, as published: their deviations are \
                not determined";
    let evidence = JointEvidence {
        covariance: SMatrix::identity() * UNKNOWN,
        state1_from_state0: *state1_from_state0,
        inliers: 0,
        tried: 0,
        residual_rms_m: 0.0,
        position_std: vec![UNKNOWN.sqrt()],
        pitch_std_m_per_rad: 0.0,
        dispersion: 1.0,
        type_scores: TypeScores::default(),
        parents: BTreeMap::new(),
        axis_alone: None,
        cautions: vec![Note::new(NoteCode::JointAsPublished, text).into()],
        not_observable: Vec::new(),
    };
    let joint = JointEstimate {
        kind,
        axis,
        point,
        positions: vec![position],
        motions: vec![motion],
        covariances: vec![Matrix6::identity() * UNKNOWN],
        drawn: vec![Vec::new()],
        evidence,
    };
    TreeJointEstimate { parent: 0, joint }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_is_a_turn_from_ten_degrees_on() {
        let axis = Unit::new_normalize(Vector3::new(0.2, -0.5, 1.0));
        let pivot = Point3::new(0.3, 0.1, -0.2);
        let middle = Point3::new(1.0, 1.0, 1.0);
        let turned = |degrees: f64, advance_m: f64| {
            let screw = Screw { direction: axis, point: pivot, angle_rad: degrees.to_radians(), advance_m };
            (published_joint(&screw.to_motion(), &middle).joint, screw)
        };
        let (joint, screw) = turned(10.5, 0.002);
        assert_eq!(joint.kind, JointKind::Revolute);
        assert!((joint.positions[0] - screw.angle_rad).abs() < 1e-12 && joint.axis.dot(&axis) > 1.0 - 1e-12);
        // On the axis, and nearest to the part.
        assert!((joint.point - pivot).cross(&axis).norm() < 1e-9);
        assert!((joint.point - middle).dot(&axis).abs() < 1e-9);
        // The advance is no part of a revolute joint.
        assert!((joint.motions[0] * pivot - pivot).norm() < 1e-9);
        let (joint, screw) = turned(9.5, 0.3);
        let shift = screw.to_motion().translation.vector;
        assert_eq!(joint.kind, JointKind::Prismatic);
        assert!((joint.positions[0] - shift.norm()).abs() < 1e-12);
        assert!((joint.motions[0] * middle - middle - shift).norm() < 1e-12);
    }
}
