//! The diagnosis of a twin from frames.

use crate::{
    camera::{
        judge::{finding::CameraFinding, proof::FrameGap},
        model::{hypothesis::Hypothesis, scales::Scales, twin::SeenTwin},
    },
    judge::verdict::Verdict,
};
use common::note::Note;

/// The diagnosis of a twin from frames.
pub struct FrameDiagnosis {
    /// Verdict.
    pub verdict: Verdict,
    /// Findings.
    pub findings: Vec<CameraFinding>,
    /// The twin, with the joint types found in the frames.
    pub twin: SeenTwin,
    /// The twin as given, fitted.
    pub before: Hypothesis,
    /// The twin with the effects found, fitted.
    pub after: Hypothesis,
    /// Gap on the held-out frames.
    pub gap: FrameGap,
    /// Parts where the twin and the frames disagree.
    pub places: Vec<OutstandingPart>,
    /// Lengths from which the gates are derived.
    pub scales: Scales,
    /// Further notes.
    pub notes: Vec<Note>,
}

/// A part with an outstanding residual.
#[derive(Clone, Debug, PartialEq)]
pub struct OutstandingPart {
    /// Name of the part.
    pub part: String,
    /// Root mean square residual of its patches without effects, meters.
    pub before_m: f64,
    /// The same with the effects, meters.
    pub after_m: f64,
    /// Share of its area in conflict, without effects.
    pub conflict: f64,
    /// Box of the conflicting points in the part's frame.
    pub bounds: Option<[[f64; 3]; 2]>,
}
