//! A joint has play: its child stands off the joint's motion by a small rigid motion that differs from state to state.
//!
//! Signature: every state has a residual of the child's subtree of its own, small, that no axis explains.

use crate::gap::camera::{
    parameter::Parameter,
    trial::{CameraEffect, STATEWISE, column, free_joints},
};

/// The effect.
pub const EFFECT: CameraEffect = CameraEffect {
    name: "axis_play",
    trials: |twin, runs| {
        let prior = |k| if k < 3 { 0.004 } else { 0.015 };
        let of = |j| (0..runs.len()).flat_map(move |r| (0..6).map(move |k| column(Parameter::Extra(r, j, k), prior(k)))).collect();
        if runs.len() < 3 { Vec::new() } else { free_joints(twin).map(|j| (Some(j), of(j))).collect() }
    },
    log_odds: STATEWISE,
    tell: |f| {
        let of = |turn: bool| -> Vec<usize> {
            let is_turn = |p: &Parameter| matches!(p, Parameter::Extra(_, _, 3..));
            (0..f.trial.columns.len()).filter(|&k| is_turn(&f.trial.columns[k].parameter) == turn).collect()
        };
        let runs = (f.hypothesis.positions.len().max(1) as f64).sqrt();
        let mut told = vec![f.length("play_angle_rms", "rad", &of(true)), f.length("play_shift_rms", "m", &of(false))];
        for p in &mut told {
            (p.value, p.interval) = (p.value / runs, (p.interval.0 / runs, p.interval.1 / runs));
        }
        told
    },
    in_urdf: "not expressible",
    experiment: "push the part to and fro across its axis at one position, and film it in both",
};
