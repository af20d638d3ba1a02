//! The camera is off its reported pose by the same rigid motion in every frame (a wrong hand-eye or mount
//! transform): `world_from_camera = reported * X`.
//!
//! Signature: one rigid motion in the camera's frame explains the residuals of all views, from all sides, in
//! all states; a wrong placement of the object would be one in the world's frame.

use crate::camera::model::{
    parameter::HypothesisParameter,
    scales::MISCALIBRATED,
    trial::{CameraEffect, prior_column},
};

/// The effect.
pub(super) const EFFECT: CameraEffect = CameraEffect {
    name: "camera_extrinsic_offset",
    trials: |_, _, scales| {
        let prior = |k| MISCALIBRATED * if k < 3 { scales.range_m } else { 1.0 };
        vec![(None, (0..6).map(|k| prior_column(HypothesisParameter::Extrinsic(k), prior(k))).collect())]
    },
    log_odds: 0.0,
    reported: |f| {
        let mut all: Vec<_> =
            ["x", "y", "z"].iter().enumerate().map(|(k, n)| f.column_estimate(n, "m", k)).collect();
        all.extend(
            ["roll", "pitch", "yaw"].iter().enumerate().map(|(k, n)| f.column_estimate(n, "rad", 3 + k)),
        );
        all
    },
    types: None,
    in_urdf: "not expressible",
    experiment: "film the object from all sides and with the camera rolled by 90 degrees: \
                 an offset of the camera turns with it",
};
