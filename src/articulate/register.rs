//! Parts and motions of an object in two states by registration: proposals from lifted matches, a choice among them by
//! what they explain of the surfaces, then labels and motions in turn (method.md 4.6 and 10.4).

use nalgebra::{Point3, Vector3};
use rand_core::Rng;
use serde::{Deserialize, Serialize};

use super::{
    LiftedMatch, SurfaceSamples,
    labeling::{Evidence, FreeSpace},
    part_count::{EvidencePoint, PartCount, shares},
    ransac::{Gate, Proposal, RansacConfig, propose},
    refine::refine,
    residual::propose_from_residual,
};
use crate::geometry::Pose;

/// How parts and motions are found. Lengths are shares of the object's longest side.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RegisterConfig {
    /// Motions from matches.
    pub ransac: RansacConfig,
    /// Longest distance between a moved surface point and its partner in the first rounds.
    pub first_reach: f64,
    /// The same in the last rounds.
    pub last_reach: f64,
    /// Rounds of labels and motions in turn.
    pub rounds: usize,
    /// Least evidence for a motion and no other, in cells (of side `ransac.cell`): those of its matches beyond chance, and
    /// a sixth of those of the surface whose place contradicts the other motions. Two to three times what wrong motions
    /// reach between like parts of one object.
    pub least_score: f64,
    /// The static part must explain this share of the surface.
    pub least_static_share: f64,
}

impl Default for RegisterConfig {
    fn default() -> Self {
        Self {
            ransac: RansacConfig::default(),
            first_reach: 0.03,
            last_reach: 0.015,
            rounds: 8,
            least_score: 14.0,
            least_static_share: 0.02,
        }
    }
}

/// What supports a motion.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MotionSupport {
    /// Surface samples of state 0 and of state 1 that follow the motion.
    pub samples: [usize; 2],
    /// Lifted matches that follow it.
    pub matches: usize,
    /// Root mean square distance of these matches after the motion, metres; 0 without matches.
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
    /// Sentences about what was chosen.
    pub notes: Vec<String>,
    /// Sentences about evidence that the result leaves unexplained.
    pub warnings: Vec<String>,
}

/// Why there is no registration.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum RegisterError {
    /// The arguments make no sense.
    #[error("{what}; {remedy}")]
    Input {
        /// What is wrong.
        what: String,
        /// What to do.
        remedy: &'static str,
    },
    /// Nothing moved.
    #[error(
        "no part moved between the two states ({static_percent:.0} % of the surface stands still); record the second state with the joints moved"
    )]
    NoMotion {
        /// Share of the surface that stands still, percent.
        static_percent: f64,
    },
    /// Nothing stands still.
    #[error(
        "the two states do not overlap: {static_percent:.1} % of the surface stands still; record both states in one world frame, with the same object and one part at rest"
    )]
    NoOverlap {
        /// Share of the surface that stands still, percent.
        static_percent: f64,
    },
    /// Something moved, and no rigid motion tells how.
    #[error(
        "{moved_percent:.1} % of the surface moved between the two states, but no rigid motion explains it; record more views that overlap in both states, or a smaller motion"
    )]
    Unexplained {
        /// Share of the surface that moved unexplained, percent.
        moved_percent: f64,
    },
    /// Fewer motions are supported than were asked for.
    #[error(
        "{asked} parts were asked for, but {found} are supported (the static part and {moving} that move: {support}); ask for {found} parts or record more views of the others"
    )]
    FewerParts {
        /// Number of parts asked for.
        asked: usize,
        /// Number of parts supported, the static one included.
        found: usize,
        /// Number of moving parts supported.
        moving: usize,
        /// Support of each, in words.
        support: String,
    },
}

/// Motions that matches propose where the number of parts is to be found, beside the spare ones.
const PROPOSED: usize = 8;
/// Rounds in which the surface that is left over proposes motions.
const RESIDUAL_ROUNDS: usize = 2;

/// A sample that costs less where it is stands still.
const STANDS: f32 = 0.5;

/// Finds the rigid motions of all parts and the part of every surface sample: of `parts` parts, the static one included,
/// or of as many as the evidence supports.
///
/// `free` tells for each state whether a world point was seen empty, where known. The result depends on the order of
/// the inputs and on the random numbers only; swapping the states inverts the motions up to noise.
///
/// # Errors
/// [`RegisterError`]: no motion, no overlap, fewer motions than asked for, or movement that no motion explains.
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
    let coarse = Evidence::new(surfaces, free, reach_m(surfaces, config.first_reach * extent_m));
    let mut run = Run::new(matches, extent_m, config, coarse);
    let proposals = propose(&run.telling, wanted, extent_m, &config.ransac, rng);
    let mut motions: Vec<Pose> = std::iter::once(Pose::identity()).chain(proposals.iter().map(|p| p.state1_from_state0)).collect();
    for _ in 0..2 {
        run.round(&mut motions);
    }
    // What matches tell comes first: surface that their motions explain proposes nothing.
    motions = run.best(&run.steps(motions));
    let (mut likely, mut steps) = (motions.clone(), None);
    for _ in 0..RESIDUAL_ROUNDS {
        // Surface that a motion explains which is likely no part's may propose another.
        let more = propose_from_residual(&run.evidence, &likely, extent_m);
        if more.is_empty() {
            break;
        }
        motions.extend(more);
        run.round(&mut motions);
        let further = run.steps(motions.clone());
        let best = run.best(&further);
        likely = run.exchanged(best.clone(), &motions);
        steps = Some(if likely == best { further } else { run.steps(likely.clone()) });
    }
    if let Some(swivelled) = run.swivelled(&likely) {
        steps = Some(run.steps(swivelled));
    }
    let mut steps = steps.unwrap_or_else(|| run.steps(motions));
    run.divide(&mut steps);
    let PartCount { motions, curve, notes, warnings } = run.choose(&steps, parts)?;
    let mut motions = run.hinged(motions);
    run.evidence = Evidence::new(surfaces, free, reach_m(surfaces, config.last_reach * extent_m));
    for _ in 0..config.rounds {
        run.round(&mut motions);
    }
    let (labels, costs) = run.labels(&motions);
    let match_labels = run.match_labels(&motions);
    let shares = shares(&costs, motions.len());
    let support = (0..motions.len()).map(|k| run.support(&motions[k], k as u8, &labels, &match_labels, shares[k])).collect();
    Ok(Registration { motions, labels, match_labels, support, proposals, curve, notes, warnings })
}

/// The matches that can tell of a motion: not those between two places that both look in the other state as they do in their own.
/// Equal things in a row, such as keys, match each other where none has moved.
fn telling(matches: &[LiftedMatch], evidence: &Evidence<'_>) -> Vec<LiftedMatch> {
    let costs = [0, 1].map(|s| evidence.costs(s, &[Pose::identity()], None));
    let stands = |s: usize, p: &Point3<f64>| evidence.indices[s].nearest(p, &Vector3::zeros()).is_some_and(|i| costs[s][i] < STANDS);
    matches.iter().filter(|m| !(stands(0, &m.point0) && stands(1, &m.point1))).copied().collect()
}

/// Longest side of the box around all surfaces.
pub(super) fn checked_extent_m(surfaces: &[&SurfaceSamples], parts: Option<usize>) -> Result<f64, RegisterError> {
    let input = |what: String, remedy| Err(RegisterError::Input { what, remedy });
    if let Some(parts) = parts.filter(|p| !(2..=32).contains(p)) {
        return input(format!("{parts} parts were asked for"), "ask for 2 to 32, the static part included");
    }
    for (state, s) in surfaces.iter().enumerate() {
        if s.points.is_empty() {
            return input(format!("state {state} has no surface"), "check its depth images and masks");
        }
        if s.normals.len() != s.points.len() || s.colors.len() != s.points.len() {
            return input(format!("the surface samples of state {state} lack normals or colors"), "give one of each per point");
        }
        if s.points.iter().any(|p| !p.coords.iter().all(|x| x.is_finite())) {
            return input(format!("a surface sample of state {state} is not finite"), "check camera poses and depth");
        }
    }
    let first = surfaces[0].points[0];
    let all = surfaces.iter().flat_map(|s| s.points.iter());
    let (low, high): (Point3<f64>, Point3<f64>) = all.fold((first, first), |(lo, hi), p| (lo.inf(p), hi.sup(p)));
    let extent_m = (high - low).max();
    if extent_m > 0.0 { Ok(extent_m) } else { input("the surface has no extent".into(), "check depth images and masks") }
}

/// The wished reach, or more where the samples lie too far apart for it.
pub(super) fn reach_m(surfaces: [&SurfaceSamples; 2], wished_m: f64) -> f64 {
    let spacing_m = surfaces.map(|s| spacing_m(&s.points, wished_m));
    wished_m.max(1.5 * spacing_m[0].max(spacing_m[1]))
}

/// Mean distance of neighboring points of a surface, metres: those on an area `a` lie about `sqrt(a / n)` apart; the area is
/// that of the occupied cells.
pub(super) fn spacing_m(points: &[Point3<f64>], cell_m: f64) -> f64 {
    cell_m * (occupied_cells(points, cell_m) as f64 / points.len().max(1) as f64).sqrt()
}

/// Number of cells that hold a point.
pub(super) fn occupied_cells(points: &[Point3<f64>], cell_m: f64) -> usize {
    let mut cells: Vec<[i64; 3]> = points.iter().map(|p| [0, 1, 2].map(|k| (p[k] / cell_m).floor() as i64)).collect();
    cells.sort_unstable();
    cells.dedup();
    cells.len()
}

/// What the rounds share.
pub(super) struct Run<'a> {
    pub matches: &'a [LiftedMatch],
    /// Those of them that can tell of a motion.
    pub telling: Vec<LiftedMatch>,
    pub extent_m: f64,
    pub gate: Gate,
    pub config: &'a RegisterConfig,
    pub evidence: Evidence<'a>,
}

impl<'a> Run<'a> {
    /// For an object whose longest side is `extent_m`.
    pub fn new(matches: &'a [LiftedMatch], extent_m: f64, config: &'a RegisterConfig, evidence: Evidence<'a>) -> Self {
        Self { matches, telling: telling(matches, &evidence), extent_m, gate: Gate::new(&config.ransac, extent_m), config, evidence }
    }

    /// Labels and costs of both states.
    pub fn labels(&self, motions: &[Pose]) -> ([Vec<u8>; 2], [Vec<f32>; 2]) {
        let alone = self.labels_alone(motions);
        // Once more with each state's labels known to the other: a surface belongs to one part only.
        let costs = [0, 1].map(|s| self.evidence.costs(s, motions, Some(&alone[1 - s])));
        (self.labels_of(&costs, motions.len()), costs)
    }

    /// Labels of both states, each by itself.
    pub fn labels_alone(&self, motions: &[Pose]) -> [Vec<u8>; 2] {
        self.labels_of(&[0, 1].map(|s| self.evidence.costs(s, motions, None)), motions.len())
    }

    fn labels_of(&self, costs: &[Vec<f32>; 2], motions: usize) -> [Vec<u8>; 2] {
        let one = |s: usize| self.evidence.labels(s, &costs[s], motions);
        rayon::join(|| one(0), || one(1)).into()
    }

    /// The motion that every match follows.
    pub fn match_labels(&self, motions: &[Pose]) -> Vec<Option<u8>> {
        let one = |m: &LiftedMatch| {
            let supports = motions.iter().enumerate().map(|(k, t)| (self.gate.support(m, t), k));
            let (support, k) = supports.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))?;
            (support > 0.0).then_some(k as u8)
        };
        self.matches.iter().map(one).collect()
    }

    /// The matches that moved and follow a motion.
    pub fn followers(&self, match_labels: &[Option<u8>], label: u8) -> Vec<LiftedMatch> {
        let follows = |(m, l): &(&LiftedMatch, &Option<u8>)| **l == Some(label) && self.gate.has_moved(m);
        self.matches.iter().zip(match_labels).filter(follows).map(|(m, _)| *m).collect()
    }

    /// One round: labels, then every moving part's motion.
    pub fn round(&self, motions: &mut [Pose]) {
        let (labels, _) = self.labels(motions);
        let match_labels = self.match_labels(motions);
        for (k, motion) in motions.iter_mut().enumerate().skip(1) {
            let followers = self.followers(&match_labels, k as u8);
            *motion = refine(&self.evidence, [&labels[0], &labels[1]], &followers, motion, k as u8);
        }
    }

    fn support(&self, motion: &Pose, label: u8, labels: &[Vec<u8>; 2], match_labels: &[Option<u8>], share: f64) -> MotionSupport {
        let followers = self.matches.iter().zip(match_labels).filter(|(_, l)| **l == Some(label));
        let (squares, matches) = followers.fold((0.0, 0), |(sum, n), (m, _)| (sum + (motion * m.point0 - m.point1).norm_squared(), n + 1));
        MotionSupport {
            samples: [0, 1].map(|s| labels[s].iter().filter(|&&l| l == label).count()),
            matches,
            match_rms_m: (squares / matches.max(1) as f64).sqrt(),
            share,
        }
    }
}
