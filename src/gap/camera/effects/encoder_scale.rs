//! Reported joint positions are too small by a factor: `position = (1 + x) * reported`.
//!
//! Signature: a residual of the child's subtree along its motion, growing with the reported position.

use crate::camera::model::{
    parameter::HypothesisParameter,
    scales::MISPLACED,
    trial::{CameraEffect, prior_column},
};

/// The effect.
pub(super) const EFFECT: CameraEffect = CameraEffect {
    name: "encoder_scale",
    trials: |twin, runs, _| {
        let mut all = Vec::new();
        for (j, joint) in twin.joints.iter().enumerate() {
            if runs.iter().all(|r| r.positions.contains_key(&joint.name)) {
                all.push((Some(j), vec![prior_column(HypothesisParameter::EncoderScale(j), MISPLACED)]));
            }
        }
        all
    },
    log_odds: 0.0,
    reported: |f| {
        let mut p = f.column_estimate("scale", "1", 0);
        // `scale = reported / position`, the inverse of the column's factor.
        let low = 1.0 / (1.0 + p.interval.1);
        let high = 1.0 / (1.0 + p.interval.0);
        (p.value, p.interval) = (1.0 / (1.0 + p.value), (low, high));
        vec![p]
    },
    types: None,
    in_urdf: "not expressible",
    experiment: "film the joint at three more positions over its whole range, with its encoder recorded",
};
