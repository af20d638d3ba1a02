//! A joint that turns also advances: a screw where the twin has a revolute joint, `advance = pitch * angle`.
//!
//! Signature: a residual of the child's subtree along the axis in proportion to the position. Reported as
//! `wrong_joint_type`.

use crate::gap::camera::model::{
    parameter::Parameter,
    trial::{CameraEffect, column, free_joints},
};

/// Prior of the pitch, in sizes of the child a radian.
///
/// tuned: made objects (tests/gap_frames.rs)
const PITCH: f64 = 0.2;

/// The effect.
pub const EFFECT: CameraEffect = CameraEffect {
    name: "wrong_joint_type",
    trials: |twin, _, scales| {
        let turning = free_joints(twin).filter(|&j| twin.joints[j].kind.turns());
        turning
            .map(|j| (Some(j), vec![column(Parameter::Pitch(j), PITCH * scales.child_lever_m(twin, j))]))
            .collect()
    },
    log_odds: 0.0,
    reported: |f| vec![f.column("pitch", "m/rad", 0)],
    types: Some(["revolute", "screw"]),
    in_urdf: "not expressible",
    experiment: "film the joint at three more positions over its whole range: \
                 a screw advances with every turn",
};
