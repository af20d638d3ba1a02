//! Cautions in words about a joint and about what its states cannot show.

use crate::joints::{joint::JointEstimate, joint_type::DECISIVE};
use common::note::{Note, NoteCode};
use model::{Deviations, JointFamily, JointKind, TypeScores};

/// Standard deviation of an axis direction, radians, from which a report calls it coarse.
///
/// tuned: shared/bags
const COARSE_DIRECTION_RAD: f64 = 0.02;

/// The evidence from which a joint is judged.
pub(crate) struct JudgedJoint<'a> {
    pub kind: JointKind,
    /// Largest position relative to state 0, positive, radians or meters.
    pub motion: f64,
    pub scores: &'a TypeScores,
    /// Number of observations that agree with the joint, and of all tried.
    pub agreement: [usize; 2],
}

/// Reasons to doubt a joint, in words. Those from its standard deviations come from [`vagueness`], once they
/// are final.
pub(crate) fn cautions(joint: &JudgedJoint<'_>) -> Vec<Note> {
    let JudgedJoint { kind, motion, scores, agreement: [agree, tried] } = *joint;
    let mut cautions = Vec::new();
    let [p, r] = [JointFamily::Prismatic, JointFamily::Revolute].map(|t| scores.score_of(t));
    // A slide is a turn about an axis far away: a small motion may not distinguish them.
    if (p - r).abs() < DECISIVE {
        cautions.push(Note::new(
            NoteCode::JointTypeUndecided,
            format!(
                "prismatic and revolute explain the motion about equally well (scores {p:.1} and {r:.1})"
            ),
        ));
    }
    if matches!(kind, JointKind::Free { .. }) {
        cautions.push(Note::new(
            NoteCode::JointTypeUnknown,
            "no joint type explains the motion; the twin moves the part along the screw of it",
        ));
    }
    if motion <= 0.0 {
        cautions.push(Note::new(NoteCode::JointAtRest, "no motion"));
    }
    if agree * 2 < tried {
        cautions.push(Note::new(
            NoteCode::JointContradicted,
            format!("only {agree} of {tried} observations agree with the motion"),
        ));
    }
    cautions
}

/// Properties of a joint that the states of a part cannot show.
pub(crate) fn not_observable(kind: JointKind, states: usize) -> Vec<Note> {
    let count = if states == 2 { "two".to_owned() } else { states.to_string() };
    let mut open = vec![Note::new(
        NoteCode::LimitsNotObserved,
        format!("the joint's limits: it reaches at least the {count} observed positions"),
    )];
    if kind.turns() {
        open.push(Note::new(
            NoteCode::TurnsNotObserved,
            "whole turns: the smallest rotation between the states is taken",
        ));
    }
    if kind.pitch_m_per_rad().is_some() {
        open.push(Note::new(
            NoteCode::ScrewNotObserved,
            "a screw against a rotation and a translation of their own along one axis; the pitch rests on \
             the smallest rotation",
        ));
    }
    open
}

/// Cautions from the standard deviations of a joint; none where all are small. `extent_m` is the longest side
/// of the object.
pub(crate) fn vagueness(joint: &JointEstimate, extent_m: f64) -> Vec<Note> {
    let turns = joint.kind.turns();
    let motion = joint.largest_position().abs();
    let amount =
        if turns { format!("{:.1} deg", motion.to_degrees()) } else { format!("{:.1} mm", 1e3 * motion) };
    let deviations = Deviations::of_covariance(&joint.evidence.covariance, &joint.axis, turns, extent_m);
    let mut notes = Vec::new();
    match deviations.axis_rad {
        None => notes.push(undetermined(&amount, "axis direction")),
        Some(std) if std > COARSE_DIRECTION_RAD => {
            notes.push(coarse(&amount, "axis direction", &format!("{:.1} deg", std.to_degrees())));
        }
        Some(_) => {}
    }
    match deviations.origin_m {
        // A slide has a direction and no line.
        _ if !turns => {}
        None => notes.push(undetermined(&amount, "axis position")),
        Some(std) if std > COARSE_DIRECTION_RAD * extent_m => {
            notes.push(coarse(&amount, "axis position", &format!("{:.0} mm", 1e3 * std)));
        }
        Some(_) => {}
    }
    if deviations.motion.is_none() {
        notes.push(Note::new(NoteCode::MotionNotDetermined, "how far the joint moved is not determined"));
    }
    notes
}

fn undetermined(amount: &str, what: &str) -> Note {
    let text = format!("a motion of {amount} leaves the {what} not determined");
    Note::new(NoteCode::AxisNotDetermined, text)
}

fn coarse(amount: &str, what: &str, std: &str) -> Note {
    let text = format!("a motion of {amount} determines the {what} to +-{std} only");
    Note::new(NoteCode::AxisCoarse, text)
}
