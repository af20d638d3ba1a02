//! Told joint positions are off by a constant: `told = position + bias`.
//!
//! Signature: the same residual of the child's subtree along its motion at every told position.

use crate::gap::camera::{
    parameter::Parameter,
    trial::{CameraEffect, column},
};

/// The effect.
pub const EFFECT: CameraEffect = CameraEffect {
    name: "encoder_bias",
    trials: |twin, runs| {
        let told = |j: &usize| runs.iter().all(|r| r.positions.contains_key(&twin.joints[*j].name));
        let prior = |j: usize| if twin.joints[j].hinge.turns() { 0.05 } else { 0.015 };
        (0..twin.joints.len()).filter(told).map(|j| (Some(j), vec![column(Parameter::EncoderBias(j), prior(j))])).collect()
    },
    log_odds: 0.0,
    tell: |f| {
        let turns = f.trial.joint.is_some_and(|j| f.twin.joints[j].hinge.turns());
        let mut p = f.column("bias", if turns { "rad" } else { "m" }, 0);
        (p.value, p.interval) = (-p.value, (-p.interval.1, -p.interval.0));
        vec![p]
    },
    in_urdf: "not expressible",
    experiment: "film the joint at three more positions over its whole range, with its encoder recorded",
};
