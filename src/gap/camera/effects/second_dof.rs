//! A joint's child has a second degree of freedom: a slide or a turn beyond the joint's own, by a different
//! amount in every state.
//!
//! Signature: residuals of the child's subtree are multiples of one rigid motion, unrelated to the position.

use crate::camera::model::{
    parameter::HypothesisParameter,
    trial::{CameraEffect, STATEWISE, free_joints, prior_column},
};

/// Standard deviation of the prior of the second motion, in radians and as a share of the child's size.
///
/// tuned: made objects (tests/gap_frames.rs)
const SECOND: f64 = 0.15;

/// The effect.
pub(super) const EFFECT: CameraEffect = CameraEffect {
    name: "second_dof",
    trials: |twin, runs, scales| {
        if runs.len() < 3 {
            return Vec::new();
        }
        let mut all = Vec::new();
        for j in free_joints(twin) {
            for k in 0..6 {
                let prior = SECOND * if k < 3 { scales.child_lever_m(twin, j) } else { 1.0 };
                let columns = (0..runs.len())
                    .map(|r| prior_column(HypothesisParameter::Extra(r, j, k), prior))
                    .collect();
                all.push((Some(j), columns));
            }
        }
        all
    },
    log_odds: STATEWISE,
    reported: |f| {
        let turns = f.trial.columns.iter().any(|c| c.parameter.is_turn());
        let (name, unit) = if turns { ("turn", "rad") } else { ("slide", "m") };
        (0..f.trial.columns.len()).map(|k| f.column_estimate(&format!("{name}_{k}"), unit, k)).collect()
    },
    types: None,
    in_urdf: "not expressible",
    experiment: "hold the joint still and move the part in its second way; film three positions of it",
};
