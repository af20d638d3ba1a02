//! Reported joint positions are off by a constant: `reported = position + bias`.
//!
//! Signature: the same residual of the child's subtree along its motion at every reported position.

use crate::camera::model::{
    parameter::HypothesisParameter,
    scales::MISPLACED,
    trial::{CameraEffect, prior_column},
};

/// The effect.
pub(super) const EFFECT: CameraEffect = CameraEffect {
    name: "encoder_bias",
    trials: |twin, runs, scales| {
        let mut all = Vec::new();
        for (j, joint) in twin.joints.iter().enumerate() {
            if runs.iter().all(|r| r.positions.contains_key(&joint.name)) {
                let lever = if joint.kind.is_turning() { 1.0 } else { scales.child_lever_m(twin, j) };
                all.push((
                    Some(j),
                    vec![prior_column(HypothesisParameter::EncoderBias(j), MISPLACED * lever)],
                ));
            }
        }
        all
    },
    log_odds: 0.0,
    reported: |f| {
        let turns = f.trial.joint.is_some_and(|j| f.twin.joints[j].kind.is_turning());
        // The column is added to the reported positions, so the bias has the opposite sign.
        let mut p = f.column_estimate("bias", if turns { "rad" } else { "m" }, 0);
        (p.value, p.interval) = (-p.value, (-p.interval.1, -p.interval.0));
        vec![p]
    },
    types: None,
    in_urdf: "not expressible",
    experiment: "film the joint at three more positions over its whole range, with its encoder recorded",
};
