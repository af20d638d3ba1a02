//! Images are stamped late or early: an image was taken at the pose of time `stamp + delay`.
//!
//! Signature: a residual proportional to the camera's velocity, zero while the camera rests, with the
//! opposite sign on the way back.

use crate::camera::model::{
    parameter::HypothesisParameter,
    trial::{CameraEffect, prior_column},
};

/// Standard deviation of the prior of the offset, seconds.
///
/// chosen: one frame at 30 Hz
const FRAME_S: f64 = 1.0 / 30.0;

/// The effect.
pub(super) const EFFECT: CameraEffect = CameraEffect {
    name: "camera_time_offset",
    trials: |_, runs, _| {
        // Without the camera's velocities a delay is not observable.
        let known = runs.iter().all(|r| r.velocities.len() == r.frames.len() && !r.frames.is_empty());
        if known { vec![(None, vec![prior_column(HypothesisParameter::Delay, FRAME_S)])] } else { Vec::new() }
    },
    log_odds: 0.0,
    reported: |f| vec![f.column_estimate("offset", "s", 0)],
    types: None,
    in_urdf: "not expressible",
    experiment: "move the camera to and fro, and rest between: \
                 an offset in time vanishes at rest and changes sign with the motion",
};
