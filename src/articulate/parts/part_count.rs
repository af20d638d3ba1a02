//! Selects the parts among the proposed motions: each must explain surface that no other explains, measured
//! on samples not used for its fit.

use serde::{Deserialize, Serialize};
use tracing::debug;

use crate::{
    pair::{reprojection::ASTRAY, unexplained::Unexplained},
    parts::{
        elimination::{SLIGHT, Step, standing_sets},
        error::RegisterError,
        evidence_curve::EvidencePoint,
        matched_pair::MatchedPair,
        score::LEAST_SCORE,
    },
};
use common::note::{Note, NoteCode};
use geometry::Pose;

/// Motions with less than this many times the least evidence are reported as resting on little evidence.
/// tuned: shared/bags
pub(crate) const LITTLE: f64 = 1.5;
/// Least static share of the surface for reporting an object without moved parts.
/// chosen: the majority
const MAJORITY: f64 = 0.5;
/// Least share of the surface that the static part must explain.
/// chosen: less is what stands still by chance under a moving object
const LEAST_STATIC_SHARE: f64 = 0.02;

/// The motions that are parts.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct PartCount {
    pub motions: Vec<Pose>,
    pub curve: Vec<EvidencePoint>,
    pub notes: Vec<Note>,
    pub warnings: Vec<Note>,
}

/// The largest set of motions that each have enough evidence and split no part; it has at most `parts` parts,
/// if given.
pub(crate) fn chosen_parts(
    pair: &MatchedPair<'_>,
    steps: &[Step],
    parts: Option<usize>,
) -> Result<PartCount, RegisterError> {
    let curve: Vec<EvidencePoint> = steps.iter().map(|s| s.point.clone()).collect();
    let standing = standing_sets(steps, &curve);
    let most = standing.iter().max_by_key(|s| s.motions.len());
    let allowed = standing.iter().filter(|s| parts.is_none_or(|p| s.motions.len() <= p));
    let Some(chosen) = allowed.max_by_key(|s| s.motions.len()) else {
        return Err(RegisterError::NoOverlap { static_percent: 0.0 });
    };
    let mut notes = Vec::new();
    let mut warnings = Vec::new();
    check(pair, &chosen.motions, parts, &chosen.shares, &mut notes)?;
    let found = chosen.motions.len();
    let evident = most.map_or(found, |s| s.motions.len());
    debug!(
        parts = found,
        evident,
        asked = parts,
        weakest_cells = chosen.point.weakest,
        least_cells = LEAST_SCORE,
        static_share = chosen.shares[0],
        "number of parts chosen"
    );
    if evident > found {
        warnings.push(more_than_asked(evident, found));
    }
    if let Some(weakest) = chosen.point.weakest.filter(|w| parts.is_none() && *w < LITTLE * LEAST_SCORE) {
        warnings.push(little_evidence(found, weakest));
    }
    if chosen.divided {
        notes.push(Note::new(
            NoteCode::PartsMoveAlike,
            "parts move nearly alike: one motion explains them, a little off, and was divided where the \
             surface calls for two",
        ));
    }
    let more = curve.iter().find(|p| p.parts == found + 1).filter(|_| parts.is_none());
    notes.extend(more.and_then(|more| almost_evident(more, &chosen.point)));
    Ok(PartCount { motions: chosen.motions.clone(), curve, notes, warnings })
}

/// Refuses sets of motions that leave too much surface unexplained.
fn check(
    pair: &MatchedPair<'_>,
    motions: &[Pose],
    parts: Option<usize>,
    shares: &[f64],
    notes: &mut Vec<Note>,
) -> Result<(), RegisterError> {
    // Parts move relative to something at rest; if next to nothing is, the states likely have two world
    // frames.
    let static_percent = 100.0 * shares[0];
    let one = motions.len() == 1;
    if shares[0] < LEAST_STATIC_SHARE {
        return Err(RegisterError::NoOverlap { static_percent });
    }
    let found = motions.len();
    let moving = motions.len() - 1;
    match parts {
        Some(_) if one => Err(RegisterError::NoMotion { static_percent }),
        Some(asked) if asked > found => {
            let support: Vec<String> =
                shares.iter().skip(1).map(|s| format!("{:.1} % of the surface", 100.0 * s)).collect();
            Err(RegisterError::FewerParts { asked, found, moving, support: support.join(", ") })
        }
        _ if !one => Ok(()),
        _ => {
            let moved = Unexplained::left_by_motions(&pair.surfaces, motions).moved;
            let [share0, share1] = [0, 1].map(|s| pair.surfaces.borne_out_share(s, &moved[s]));
            let moved_percent = 100.0 * share0.max(share1);
            // Required in both states: surface missing in one only was hidden, or never seen.
            if share0.min(share1) > ASTRAY {
                return Err(RegisterError::Unexplained { moved_percent });
            }
            // Only surface seen in both states shows whether something moved: most of it must be known.
            if shares[0] < MAJORITY {
                return Err(RegisterError::LittleShared { static_percent, moved_percent });
            }
            notes.push(Note::new(
                NoteCode::NoPartMoved,
                format!(
                    "no part moved: {static_percent:.0} % of the surface stands still and \
                     {moved_percent:.1} % left its place; the twin has one part"
                ),
            ));
            Ok(())
        }
    }
}

/// The note that one motion more was nearly a part, if it was: it has too little evidence, or takes its
/// evidence from the others.
fn almost_evident(more: &EvidencePoint, chosen: &EvidencePoint) -> Option<Note> {
    let weakest = more.weakest.filter(|w| *w > SLIGHT * LEAST_SCORE)?;
    let text = if weakest < LEAST_SCORE {
        format!("a further motion has {weakest:.1} of the evidence of {LEAST_SCORE} that a part needs")
    } else {
        format!(
            "a further motion explains {weakest:.1} cells alone, but divides a part: all motions together \
             explain {:.1} cells with it and {:.1} without it",
            more.evidence, chosen.evidence
        )
    };
    Some(Note::new(NoteCode::PartAlmostEvident, text))
}

/// The note that the evidence is for more parts than asked for.
pub(crate) fn more_than_asked(evident: usize, asked: usize) -> Note {
    let text = format!("the evidence is for {evident} parts, {asked} were asked for");
    Note::new(NoteCode::MorePartsEvident, text)
}

/// The note that the weakest part rests on little evidence.
pub(crate) fn little_evidence(parts: usize, weakest: f64) -> Note {
    let text = format!(
        "one of the {parts} parts rests on little evidence: {weakest:.0} cells, where {:.0} leave no doubt",
        LITTLE * LEAST_SCORE
    );
    Note::new(NoteCode::PartOnLittleEvidence, text)
}

#[cfg(test)]
#[path = "choice_tests.rs"]
mod choice_tests;

#[cfg(test)]
#[path = "part_count_tests.rs"]
mod tests;
