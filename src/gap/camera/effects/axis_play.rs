//! A joint has play: its child departs from the joint's motion by a small rigid motion, different in every
//! state.
//!
//! Signature: a small residual of the child's subtree, different in every state, explained by no common axis.

use crate::camera::model::{
    parameter::HypothesisParameter,
    trial::{CameraEffect, Column, STATEWISE, free_joints, prior_column},
};

/// Standard deviation of the prior of play, in radians and as a share of the child's size.
///
/// tuned: made objects (tests/gap_frames.rs)
const PLAY: f64 = 0.01;

/// The effect.
pub(super) const EFFECT: CameraEffect = CameraEffect {
    name: "axis_play",
    trials: |twin, runs, scales| {
        if runs.len() < 3 {
            return Vec::new();
        }
        free_joints(twin)
            .map(|j| (Some(j), play_columns(j, runs.len(), scales.child_lever_m(twin, j))))
            .collect()
    },
    log_odds: STATEWISE,
    reported: |f| {
        let runs = (f.hypothesis.positions.len().max(1) as f64).sqrt();
        let mut all = vec![
            f.length_estimate("play_angle_rms", "rad", &f.turn_columns(true)),
            f.length_estimate("play_shift_rms", "m", &f.turn_columns(false)),
        ];
        for p in &mut all {
            // The length is taken over all recordings together; reports give the root mean square per
            // recording.
            (p.value, p.interval) = (p.value / runs, (p.interval.0 / runs, p.interval.1 / runs));
        }
        all
    },
    types: None,
    in_urdf: "not expressible",
    experiment: "push the part to and fro across its axis at one position, and film it in both",
};

/// Columns of a small rigid motion of a joint's child in every run; `lever_m` is the child's lever.
fn play_columns(joint: usize, runs: usize, lever_m: f64) -> Vec<Column> {
    let mut columns = Vec::with_capacity(6 * runs);
    for run in 0..runs {
        for k in 0..6 {
            let prior = PLAY * if k < 3 { lever_m } else { 1.0 };
            columns.push(prior_column(HypothesisParameter::Extra(run, joint, k), prior));
        }
    }
    columns
}
