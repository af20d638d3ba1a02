//! A turning joint also advances: a screw where the twin has a revolute joint, `advance = pitch * angle`.
//!
//! Signature: a residual of the child's subtree along the axis, proportional to the position. Reported as
//! `wrong_joint_type`.

use crate::camera::model::{
    parameter::HypothesisParameter,
    scales::{GATE, MISPLACED},
    trial::{CameraEffect, free_joints, prior_column},
};

/// Least pitch tried by a search, in sizes of the child per radian.
///
/// derived: half a turn moves part of the object off its surface; a smaller pitch is found by refining the
/// revolute joint
pub const LEAST_PITCH: f64 = GATE * MISPLACED / std::f64::consts::PI;
/// Number of searched pitches in each direction, each twice the one before.
pub const PITCHES: i32 = 5;
/// Standard deviation of the prior of the pitch, in sizes of the child per radian.
///
/// derived: half the largest searched pitch
const PITCH: f64 = 0.5 * LEAST_PITCH * (1 << (PITCHES - 1)) as f64;

/// The effect.
pub const EFFECT: CameraEffect = CameraEffect {
    name: "wrong_joint_type",
    trials: |twin, _, scales| {
        let turning = free_joints(twin).filter(|&j| twin.joints[j].kind.is_turning());
        turning
            .map(|j| {
                (
                    Some(j),
                    vec![prior_column(HypothesisParameter::Pitch(j), PITCH * scales.child_lever_m(twin, j))],
                )
            })
            .collect()
    },
    log_odds: 0.0,
    reported: |f| vec![f.column_estimate("pitch", "m/rad", 0)],
    types: Some(["revolute", "screw"]),
    in_urdf: "not expressible",
    experiment: "film the joint at three more positions over its whole range: \
                 a screw advances with every turn",
};
