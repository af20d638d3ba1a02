//! Images are stamped late or early: the pose at `stamp + delay` is that of the image.
//!
//! Signature: a residual in proportion to the camera's velocity, none while it rests, of the other sign on the way back.

use crate::gap::camera::{
    parameter::Parameter,
    trial::{CameraEffect, column},
};

/// The effect.
pub const EFFECT: CameraEffect = CameraEffect {
    name: "camera_time_offset",
    trials: |_, runs| {
        let known = runs.iter().all(|r| r.velocities.len() == r.frames.len() && !r.frames.is_empty());
        if known { vec![(None, vec![column(Parameter::Delay, 0.03)])] } else { Vec::new() }
    },
    log_odds: 0.0,
    tell: |f| vec![f.column("offset", "s", 0)],
    in_urdf: "not expressible",
    experiment: "move the camera to and fro, and rest between: an offset in time vanishes at rest and changes sign with the motion",
};
