//! What speaks against trusting a joint, and what its states cannot show, in words.

use crate::joints::{joint::JointEstimate, joint_type::DECISIVE};
use common::note::{Note, NoteCode};
use model::{Deviations, JointFamily, JointKind, TypeScores};

/// Standard deviation of an axis direction, radians, from which a report calls it coarse.
///
/// tuned: shared/bags
const COARSE_DIRECTION_RAD: f64 = 0.02;

/// What a joint is judged by.
pub(crate) struct Judged<'a> {
    pub kind: JointKind,
    /// Farthest from state 0, positive.
    pub motion: f64,
    pub scores: &'a TypeScores,
    /// Observations that agree with the joint, of those tried.
    pub agreement: [usize; 2],
}

/// What speaks against trusting a joint, in words; [`vagueness`] adds what its deviations say, once they are
/// final.
pub(crate) fn cautions(joint: &Judged<'_>) -> Vec<Note> {
    let Judged { kind, motion, scores, agreement: [agree, tried] } = *joint;
    let mut cautions = Vec::new();
    let [p, r] = [JointFamily::Prismatic, JointFamily::Revolute].map(|t| scores.of(t));
    // A slide is a turn about an axis far away, so that a small motion may not distinguish them.
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

/// What some states of a part cannot show.
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

/// What the deviations say of a joint of an object whose longest side is `extent_m`; none where all
/// are small.
pub(crate) fn vagueness(joint: &JointEstimate, extent_m: f64) -> Vec<Note> {
    let turns = joint.kind.turns();
    let motion = joint.motion().abs();
    let amount =
        if turns { format!("{:.1} deg", motion.to_degrees()) } else { format!("{:.1} mm", 1e3 * motion) };
    let deviations = Deviations::of(&joint.evidence.covariance, &joint.axis, turns, extent_m);
    let undetermined = |what: &str| {
        let text = format!("a motion of {amount} leaves the {what} not determined");
        Some(Note::new(NoteCode::AxisNotDetermined, text))
    };
    let coarse = |what: &str, std: String| {
        let text = format!("a motion of {amount} determines the {what} to +-{std} only");
        Some(Note::new(NoteCode::AxisCoarse, text))
    };
    let direction = match deviations.axis_rad {
        None => undetermined("axis direction"),
        Some(std) if std > COARSE_DIRECTION_RAD => {
            coarse("axis direction", format!("{:.1} deg", std.to_degrees()))
        }
        Some(_) => None,
    };
    let position = match deviations.origin_m {
        // A slide has a direction and no line.
        _ if !turns => None,
        None => undetermined("axis position"),
        Some(std) if std > COARSE_DIRECTION_RAD * extent_m => {
            coarse("axis position", format!("{:.0} mm", 1e3 * std))
        }
        Some(_) => None,
    };
    let size = deviations
        .motion
        .is_none()
        .then(|| Note::new(NoteCode::MotionNotDetermined, "how far the joint moved is not determined"));
    [direction, position, size].into_iter().flatten().collect()
}
