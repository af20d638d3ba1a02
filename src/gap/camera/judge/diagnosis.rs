//! The diagnosis of a twin by frames.

use crate::{
    camera::{
        judge::{finding::CameraFinding, proof::FrameGap},
        model::{hypothesis::Hypothesis, scales::Scales, twin::SeenTwin},
    },
    judge::verdict::Verdict,
};
use common::note::Note;

/// The diagnosis.
pub struct FrameDiagnosis {
    /// Verdict.
    pub verdict: Verdict,
    /// Findings.
    pub findings: Vec<CameraFinding>,
    /// The twin, its joints of the types found in the frames.
    pub twin: SeenTwin,
    /// Twin as it was given, fitted.
    pub before: Hypothesis,
    /// Twin with the effects found.
    pub after: Hypothesis,
    /// Gap on held-out frames.
    pub gap: FrameGap,
    /// Where the twin and the frames disagree.
    pub places: Vec<OutstandingPart>,
    /// Lengths behind the gates.
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
    /// With them.
    pub after_m: f64,
    /// Conflicting share of its area, without effects.
    pub conflict: f64,
    /// Box of the conflicting points in the part's frame.
    pub bounds: Option<[[f64; 3]; 2]>,
}
