//! A joint that turns also advances: a screw where the twin has a hinge, `advance = pitch * angle`.
//!
//! Signature: a residual of the child's subtree along the axis in proportion to the position. Reported as
//! `wrong_joint_type`.

use crate::gap::camera::{
    parameter::Parameter,
    trial::{CameraEffect, column, free_joints},
};

/// The effect.
pub const EFFECT: CameraEffect = CameraEffect {
    name: "wrong_joint_type",
    trials: |twin, _| {
        let turning = free_joints(twin).filter(|&j| twin.joints[j].hinge.turns());
        turning.map(|j| (Some(j), vec![column(Parameter::Pitch(j), 0.01)])).collect()
    },
    log_odds: 0.0,
    tell: |f| vec![f.column("pitch", "m/rad", 0)],
    in_urdf: "not expressible",
    experiment: "film the joint at three more positions over its whole range: a screw advances with every turn",
};
