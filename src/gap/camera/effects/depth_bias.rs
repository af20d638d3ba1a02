//! Depth readings are too long by a constant length: `reading = depth + bias`.
//!
//! Signature: the same residual along every ray, near and far, on every part, in every state.

use crate::camera::model::{
    parameter::HypothesisParameter,
    scales::MISCALIBRATED,
    trial::{CameraEffect, prior_column},
};

/// The effect.
pub(super) const EFFECT: CameraEffect = CameraEffect {
    name: "depth_bias",
    trials: |_, _, scales| {
        vec![(None, vec![prior_column(HypothesisParameter::DepthBias, MISCALIBRATED * scales.range_m)])]
    },
    log_odds: 0.0,
    reported: |f| vec![f.column_estimate("bias", "m", 0)],
    types: None,
    in_urdf: "not expressible",
    experiment: "film the object from half and from twice the distance, and steep views of flat parts: a \
                 bias acts along the ray, a camera that stands off along its view shifts all points alike",
};
