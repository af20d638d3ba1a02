//! A joint's child moves in a second way: a slide or a turn beyond the joint's own, by another amount in every state.
//!
//! Signature: residuals of the child's subtree that are multiples of one rigid motion, unrelated to the position.

use crate::gap::camera::{
    parameter::Parameter,
    trial::{CameraEffect, STATEWISE, column, free_joints},
};

/// The effect.
pub const EFFECT: CameraEffect = CameraEffect {
    name: "second_dof",
    trials: |twin, runs| {
        let prior = |k| if k < 3 { 0.04 } else { 0.2 };
        let of = |j, k| (0..runs.len()).map(move |r| column(Parameter::Extra(r, j, k), prior(k))).collect();
        if runs.len() < 3 { Vec::new() } else { free_joints(twin).flat_map(|j| (0..6).map(move |k| (Some(j), of(j, k)))).collect() }
    },
    log_odds: STATEWISE,
    tell: |f| {
        let turns = matches!(f.trial.columns.first().map(|c| c.parameter), Some(Parameter::Extra(_, _, 3..)));
        let (name, unit) = if turns { ("turn", "rad") } else { ("slide", "m") };
        (0..f.trial.columns.len()).map(|k| f.column(&format!("{name}_{k}"), unit, k)).collect()
    },
    in_urdf: "not expressible",
    experiment: "hold the joint still and move the part in its second way; film three positions of it",
};
