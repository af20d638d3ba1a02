//! Depth readings are too long in proportion to the depth: `reading = scale * depth`.
//!
//! Signature: a residual along the ray proportional to the depth, on every part, in every state.

use crate::camera::model::{
    parameter::HypothesisParameter,
    scales::MISCALIBRATED,
    trial::{CameraEffect, prior_column},
};

/// The effect.
pub(super) const EFFECT: CameraEffect = CameraEffect {
    name: "depth_scale",
    trials: |_, _, _| vec![(None, vec![prior_column(HypothesisParameter::DepthScale, MISCALIBRATED)])],
    log_odds: 0.0,
    reported: |f| {
        // The column holds `scale - 1`.
        let mut p = f.column_estimate("scale", "1", 0);
        (p.value, p.interval) = (1.0 + p.value, (1.0 + p.interval.0, 1.0 + p.interval.1));
        vec![p]
    },
    types: None,
    in_urdf: "not expressible",
    experiment: "film the object from half and from twice the distance: \
                 a scale grows with the distance, a bias does not",
};
