//! A joint's axis lies elsewhere or points elsewhere.
//!
//! Two ways: the line alone is off, so that the child is right at position 0 and leaves its place as it moves,
//! `M' = D M D^-1`; or the joint's frame is off with the child, `M' = D M`. Signature: a residual of the child's subtree
//! that grows with the position (the line), or is the same rigid motion of it in every state (the frame).

use crate::gap::camera::{
    parameter::Parameter,
    trial::{CameraEffect, column, free_joints},
};

/// Prior of shifts, metres.
const SHIFT_M: f64 = 0.015;
/// Prior of turns, radians.
const TURN_RAD: f64 = 0.05;

/// The effect.
pub const EFFECT: CameraEffect = CameraEffect {
    name: "axis_offset",
    trials: |twin, _| {
        let mut all = Vec::new();
        for j in free_joints(twin) {
            let hinge = twin.joints[j].hinge.turns();
            let turns: Vec<_> = (0..2).map(|k| column(Parameter::AxisTurn(j, k), TURN_RAD)).collect();
            let shifts: Vec<_> = (0..2).map(|k| column(Parameter::AxisShift(j, k), SHIFT_M)).collect();
            if hinge {
                all.push((Some(j), [turns.clone(), shifts.clone()].concat()));
                all.push((Some(j), shifts));
            }
            all.push((Some(j), turns));
            // Along the axis of a slide a shift is a change of position.
            let shifts: Vec<_> = (0..if hinge { 3 } else { 2 }).map(|k| column(Parameter::Frame(j, k), SHIFT_M)).collect();
            let turns: Vec<_> = (3..5).map(|k| column(Parameter::Frame(j, k), TURN_RAD)).collect();
            all.push((Some(j), [shifts.clone(), turns.clone()].concat()));
            all.extend([(Some(j), shifts), (Some(j), turns)]);
        }
        all
    },
    log_odds: 0.0,
    tell: |f| {
        let of = |turn: bool| -> Vec<usize> {
            let is_turn = |p: &Parameter| matches!(p, Parameter::AxisTurn(..) | Parameter::Frame(_, 3..));
            (0..f.trial.columns.len()).filter(|&k| is_turn(&f.trial.columns[k].parameter) == turn).collect()
        };
        let told = [("axis_angle", "rad", of(true)), ("axis_position", "m", of(false))];
        told.into_iter().filter(|t| !t.2.is_empty()).map(|(name, unit, columns)| f.length(name, unit, &columns)).collect()
    },
    in_urdf: "native",
    experiment: "film the joint at three more positions over its whole range",
};
