//! Parts and motions of an object in two states by registration: proposals from lifted matches, a choice
//! among them by what they explain of the surfaces, then labels and motions in turn (docs/method.md 6.10).

use nalgebra::Point3;
use rand_core::Rng;
use serde::{Deserialize, Serialize};

use crate::geometry::Pose;
use crate::{
    articulate::{
        observations::{LiftedMatch, SurfaceSamples},
        pair::surface_pair::{FreeSpace, SurfacePair},
        parts::{
            config::RegisterConfig,
            division::divide,
            elimination::{best, steps},
            end_for_end::hinged,
            error::RegisterError,
            evidence_curve::EvidencePoint,
            exchange::exchanged,
            labeling::label_of_all,
            matched_pair::MatchedPair,
            part_count::{PartCount, choose},
            round_parts::turned_round,
            score::shares,
            settle::round,
        },
        propose::{
            ransac::{Proposal, propose},
            residual::propose_from_residual,
        },
        samples::spacing::reach_m,
    },
    note::Note,
};

/// What supports a motion.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MotionSupport {
    /// Surface samples of state 0 and of state 1 that follow the motion.
    pub samples: [usize; 2],
    /// Lifted matches that follow it.
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
    /// Scores by number of parts, most parts first.
    pub curve: Vec<EvidencePoint>,
    /// Sentences about what was chosen.
    pub notes: Vec<Note>,
    /// Sentences about evidence that the result leaves unexplained.
    pub warnings: Vec<Note>,
}

/// Motions that matches propose where the number of parts is to be found, beside the spare ones.
const PROPOSED: usize = 8;
/// Rounds in which the surface that is left over proposes motions.
const RESIDUAL_ROUNDS: usize = 2;

/// Finds the rigid motions of all parts and the part of every surface sample: of `parts` parts, the static
/// one included, or of as many as the evidence supports.
///
/// `free` says for each state whether a world point was seen empty, where known. The result depends on the
/// order of the inputs and on the random numbers only; swapping the states inverts the motions up to noise.
///
/// # Errors
/// [`RegisterError`]: no motion, no overlap, fewer motions than asked for, or movement that no motion
/// explains.
pub fn register(
    matches: &[LiftedMatch],
    surfaces: [&SurfaceSamples; 2],
    free: [Option<FreeSpace<'_>>; 2],
    parts: Option<usize>,
    config: &RegisterConfig,
    rng: &mut impl Rng,
) -> Result<Registration, RegisterError> {
    let extent_m = checked_extent_m(&surfaces, parts)?;
    let wanted = parts.map_or(PROPOSED, |p| p - 1);
    // 1. Motions by matches, on a reach that forgives rough ones (docs/method.md 6.10).
    let coarse = SurfacePair::new(surfaces, free, reach_m(surfaces, config.first_reach * extent_m));
    let mut pair = MatchedPair::new(matches, extent_m, config, coarse);
    let proposals = propose(&pair.informative, wanted, extent_m, &config.ransac, rng);
    let mut motions: Vec<Pose> =
        std::iter::once(Pose::identity()).chain(proposals.iter().map(|p| p.state1_from_state0)).collect();
    for _ in 0..2 {
        round(&pair, &mut motions);
    }
    // Motions of matches come first: surface that they explain proposes nothing.
    motions = best(&pair, &steps(&pair, motions));
    // 2. Motions by geometry, of the surface that is left over.
    let (mut likely, mut tried) = (motions.clone(), None);
    for _ in 0..RESIDUAL_ROUNDS {
        // Surface that a motion explains which is likely no part's may propose another.
        let more = propose_from_residual(&pair.surfaces, &likely, extent_m);
        if more.is_empty() {
            break;
        }
        motions.extend(more);
        round(&pair, &mut motions);
        let further = steps(&pair, motions.clone());
        let found = best(&pair, &further);
        likely = exchanged(&pair, found.clone(), &motions);
        tried = Some(if likely == found { further } else { steps(&pair, likely.clone()) });
    }
    // 3. Round parts, whose turn the rounds before could not find.
    if let Some(turned) = turned_round(&pair, &likely) {
        tried = Some(steps(&pair, turned));
    }
    // 4. Division, once every motion that could be a part's is there, and the number of parts.
    let mut tried = tried.unwrap_or_else(|| steps(&pair, motions));
    divide(&pair, &mut tried);
    let PartCount { motions, curve, notes, warnings } = choose(&pair, &tried, parts)?;
    // 5. Parts turned end for end: what their surface leaves open, a hinge decides.
    let mut motions = hinged(&pair, motions);
    // 6. Rounds at a short reach, which leaves out partners that only seem to fit.
    pair.surfaces = SurfacePair::new(surfaces, free, reach_m(surfaces, config.last_reach * extent_m));
    for _ in 0..config.rounds {
        round(&pair, &mut motions);
    }
    let (labels, costs) = label_of_all(&pair.surfaces, &motions);
    let match_labels = pair.match_labels(&motions);
    let shares = shares(&costs, motions.len());
    let support = (0..motions.len())
        .map(|k| support(&pair, &motions[k], k as u8, &labels, &match_labels, shares[k]))
        .collect();
    Ok(Registration { motions, labels, match_labels, support, proposals, curve, notes, warnings })
}

/// Longest side of the box around all surfaces.
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
    let first = surfaces[0].points[0];
    let all = surfaces.iter().flat_map(|s| s.points.iter());
    let (low, high): (Point3<f64>, Point3<f64>) =
        all.fold((first, first), |(lo, hi), p| (lo.inf(p), hi.sup(p)));
    let extent_m = (high - low).max();
    if extent_m > 0.0 {
        Ok(extent_m)
    } else {
        input("the surface has no extent".into(), "check depth images and masks")
    }
}

fn support(
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
