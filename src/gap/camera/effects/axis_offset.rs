//! The axis of a joint has another place or direction than in the twin.
//!
//! Two cases. The axis alone is off: the child is right at position 0 and departs from its place as it moves,
//! `M' = D M D^-1`. Or the joint's frame is off together with the child, `M' = D M`. Signature: a residual of
//! the child's subtree, growing with the position (axis), or the same rigid motion in every state (frame).

use crate::{
    camera::model::{
        parameter::HypothesisParameter,
        scales::MISPLACED,
        trial::{CameraEffect, Column, free_joints, prior_column},
    },
    judge::finding::ParameterEstimate,
};
use numeric::statistics::HALF_WIDTH_95;

/// The effect.
pub(super) const EFFECT: CameraEffect = CameraEffect {
    name: "axis_offset",
    trials: |twin, _, scales| {
        let mut all = Vec::new();
        for j in free_joints(twin) {
            let shift_m = MISPLACED * scales.child_lever_m(twin, j);
            let turning = twin.joints[j].kind.is_turning();
            // Turn, shift and both together are trials of their own: where one suffices, its evidence is
            // higher because it has fewer columns.
            let turns = columns_of_normals(HypothesisParameter::AxisTurn, j, MISPLACED);
            if turning {
                let shifts = columns_of_normals(HypothesisParameter::AxisShift, j, shift_m);
                all.push((Some(j), [turns.clone(), shifts.clone()].concat()));
                all.push((Some(j), shifts));
            }
            all.push((Some(j), turns));
            // A shift along the axis of a slide is only a change of position.
            let along = if turning { 3 } else { 2 };
            let shifts: Vec<_> =
                (0..along).map(|k| prior_column(HypothesisParameter::Frame(j, k), shift_m)).collect();
            let turns: Vec<_> =
                (3..5).map(|k| prior_column(HypothesisParameter::Frame(j, k), MISPLACED)).collect();
            all.push((Some(j), [shifts.clone(), turns.clone()].concat()));
            all.extend([(Some(j), shifts), (Some(j), turns)]);
        }
        all
    },
    log_odds: 0.0,
    reported: |f| {
        let own = f.trial.joint.and_then(|j| f.twin.own.joints.get(j)).copied().unwrap_or_default();
        let all = [
            ("axis_angle", "rad", f.turn_columns(true), own.axis_rad),
            ("axis_position", "m", f.turn_columns(false), own.place_m),
        ];
        all.into_iter()
            .filter(|(_, _, columns, _)| !columns.is_empty())
            .map(|(name, unit, columns, own)| with_own_error(f.length_estimate(name, unit, &columns), own))
            .collect()
    },
    types: None,
    in_urdf: "native",
    experiment: "film the joint at three more positions over its whole range",
};

/// Prior columns of an axis parameter, one for each of the two normals of the axis.
fn columns_of_normals(
    parameter: fn(usize, usize) -> HypothesisParameter,
    joint: usize,
    prior: f64,
) -> Vec<Column> {
    (0..2).map(|k| prior_column(parameter(joint, k), prior)).collect()
}

/// Widens the interval of a length by the twin's own error, the standard deviation `own`.
fn with_own_error(mut p: ParameterEstimate, own: f64) -> ParameterEstimate {
    let own = HALF_WIDTH_95 * own;
    p.interval =
        (p.value - (p.value - p.interval.0).hypot(own), p.value + (p.interval.1 - p.value).hypot(own));
    p.interval.0 = p.interval.0.max(0.0);
    p
}
