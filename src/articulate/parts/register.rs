//! The registration of two states, and the support of its motions.

use serde::{Deserialize, Serialize};

use crate::{
    observations::SurfaceSamples,
    parts::{error::RegisterError, evidence_curve::EvidencePoint, matched_pair::MatchedPair},
    propose::ransac::Proposal,
};
use common::note::Note;
use geometry::{Pose, bounding_box};

/// Support of a motion.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MotionSupport {
    /// Number of surface samples that follow it in state 0 and in state 1.
    pub samples: [usize; 2],
    /// Number of lifted matches that follow it.
    pub matches: usize,
    /// Root mean square distance of these matches after the motion, meters; 0 without matches.
    pub match_rms_m: f64,
    /// Share of all samples that only this motion explains.
    pub share: f64,
}

/// Parts and motions.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Registration {
    /// Motion of every part from state 0 to state 1 in the world; the first is the static part's identity.
    pub motions: Vec<Pose>,
    /// Part of every surface sample of each state.
    pub labels: [Vec<u8>; 2],
    /// Part of every lifted match; `None` where it follows no motion.
    pub match_labels: Vec<Option<u8>>,
    /// Support of every motion.
    pub support: Vec<MotionSupport>,
    /// Motions proposed by the matches, strongest first.
    pub proposals: Vec<Proposal>,
    /// Evidence by number of parts, most parts first.
    pub curve: Vec<EvidencePoint>,
    /// Sentences about the choice.
    pub notes: Vec<Note>,
    /// Sentences about unexplained evidence.
    pub warnings: Vec<Note>,
}

/// Longest side of the box around all surfaces, meters, once the inputs are checked.
pub(crate) fn checked_extent_m(
    surfaces: &[&SurfaceSamples],
    parts: Option<usize>,
) -> Result<f64, RegisterError> {
    let input = |what: String, remedy| Err(RegisterError::Input { what, remedy });
    if let Some(parts) = parts.filter(|p| !(2..=32).contains(p)) {
        return input(format!("{parts} parts were asked for"), "ask for 2 to 32, the static part included");
    }
    for (state, s) in surfaces.iter().enumerate() {
        if s.points.is_empty() {
            return input(format!("state {state} has no surface"), "check its depth images and masks");
        }
        if s.normals.len() != s.points.len() || s.colors.len() != s.points.len() {
            return input(
                format!("the surface samples of state {state} lack normals or colors"),
                "give one of each per point",
            );
        }
        if s.points.iter().any(|p| !p.coords.iter().all(|x| x.is_finite())) {
            return input(
                format!("a surface sample of state {state} is not finite"),
                "check camera poses and depth",
            );
        }
    }
    let all = surfaces.iter().flat_map(|s| s.points.iter().copied());
    let extent_m = bounding_box(all).map_or(0.0, |(low, high)| (high - low).max());
    if extent_m > 0.0 {
        Ok(extent_m)
    } else {
        input("the surface has no extent".into(), "check depth images and masks")
    }
}

/// Support of a motion of a registration.
pub(crate) fn motion_support(
    pair: &MatchedPair<'_>,
    motion: &Pose,
    label: u8,
    labels: &[Vec<u8>; 2],
    match_labels: &[Option<u8>],
    share: f64,
) -> MotionSupport {
    let followers = pair.matches.iter().zip(match_labels).filter(|(_, l)| **l == Some(label));
    let (squares, matches) = followers
        .fold((0.0, 0), |(sum, n), (m, _)| (sum + (motion * m.point0 - m.point1).norm_squared(), n + 1));
    MotionSupport {
        samples: [0, 1].map(|s| labels[s].iter().filter(|&&l| l == label).count()),
        matches,
        match_rms_m: (squares / matches.max(1) as f64).sqrt(),
        share,
    }
}
