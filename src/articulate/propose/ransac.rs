//! Proposes rigid motions from lifted matches: sequential RANSAC (Fischler and Bolles 1981) over local
//! triples. See docs/method.md 6.1.

use std::collections::BTreeMap;

use nalgebra::Point3;
use rand_core::Rng;
use serde::{Deserialize, Serialize};

use crate::observations::LiftedMatch;
use geometry::{Pose, rigid_fit};

/// A rigid motion supported by some matches.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Proposal {
    /// The motion in the world.
    pub state1_from_state0: Pose,
    /// Support in cells (the smaller sum of the two states); each cell counts by its best match (1 on the
    /// motion, 0 at the gate).
    pub support: f64,
    /// Number of supporting matches.
    pub matches: usize,
    /// Root mean square distance of the supporting matches after the motion, meters.
    pub rms_m: f64,
    /// Displacement of the supporting matches, meters: nine in ten of them moved at most this far.
    pub displacement_m: f64,
}

/// Triples tried for every motion.
const TRIALS: usize = 6000;
/// A match within this many standard deviations of a motion supports it.
/// chosen: 0.3 % of the errors of a normal distribution are larger
const GATE_SIGMAS: f64 = 3.0;
/// No match farther than this from a motion supports it, however noisy it is. A share of the object's longest
/// side. tuned: shared/bags
const GATE: f64 = 0.0125;
/// A match must have moved by more than this, and by more than its gate, to be evidence for a motion. A share
/// of the object's longest side.
/// chosen: somewhat more than [`GATE`], so that no match of a static part supports two motions
const MOVED: f64 = 0.015;
/// Side of the cells in which support is counted, as a share of the object's longest side.
/// tuned: shared/bags
const CELL: f64 = 0.02;
/// Least support of a motion, in cells; each cell counts by its best match (1 on the motion, 0 at the gate).
/// derived: three matches fix a motion
const LEAST_SUPPORT: f64 = 3.0;
/// A motion whose supporting matches moved by less than this many times [`MOVED`] is mere slack of the static
/// part. tuned: shared/bags
const SLACK: f64 = 2.5;
/// Motions proposed beyond those asked for.
const SPARE: usize = 6;

/// Number of cells of matches that are no evidence: of a few hundred wrong matches, this many follow the best
/// of all motions by chance. Three fix the motion, and where one in a thousand is within the gate, six or
/// seven of 300 are expected on some motion of the 300^3 / 6 (number of false alarms, Moisan and Stival
/// 2004).
/// tuned: shared/bags
pub(crate) const CHANCE: f64 = 5.0;
/// Two motions that differ by less than this many gates in one place are the same.
/// tuned: shared/bags
const TWIN_GATES: f64 = 2.5;
/// A motion with at least this share of another's support is not a duplicate: badly placed matches seldom
/// agree.
/// tuned: shared/bags
const TWIN_SUPPORT: f64 = 0.3;
/// Radii within which triples of matches are drawn, in turn, as shares of the object's longest side.
/// chosen: from a small part to half the object
const TRIPLE_RADII: [f64; 4] = [0.1, 0.2, 0.35, 0.5];
/// Two matches closer than this share of the object's longest side are in the same place.
/// tuned: shared/bags
const TWIN_DISTANCE: f64 = 0.06;

/// How far matches may be from a motion they support, and how far they must move, in meters.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gate {
    sigmas: f64,
    most_m: f64,
    moved_m: f64,
}

impl Gate {
    /// The gate for an object with a longest side of `extent_m`.
    pub(crate) fn new(extent_m: f64) -> Self {
        Self { sigmas: GATE_SIGMAS, most_m: GATE * extent_m, moved_m: MOVED * extent_m }
    }

    /// Largest distance of a match from a motion it supports, meters.
    pub(crate) fn distance_m(&self, sigma_m: f64) -> f64 {
        (self.sigmas * sigma_m).min(self.most_m)
    }

    /// Whether a match has moved enough to contradict a static surface.
    pub(crate) fn has_moved(&self, m: &LiftedMatch) -> bool {
        (m.point1 - m.point0).norm() > self.moved_m.max(self.sigmas * m.sigma_m)
    }

    /// How much a match supports a motion: 1 on it, falling with the squared distance to 0 at the gate.
    pub(crate) fn support(&self, m: &LiftedMatch, motion: &Pose) -> f64 {
        let distance = self.distance_m(m.sigma_m);
        (1.0 - (motion * m.point0 - m.point1).norm_squared() / (distance * distance)).max(0.0)
    }

    /// Whether a match agrees with a motion.
    pub(crate) fn supports(&self, m: &LiftedMatch, motion: &Pose) -> bool {
        self.support(m, motion) > 0.0
    }
}

/// Motions supported by the moved matches, strongest first; each comes from the matches that earlier ones
/// left. Slack of the static part and motions already found are skipped. `extent_m` is the object's longest
/// side; at most `motions` and [`SPARE`] more are returned.
pub(crate) fn proposed_motions(
    matches: &[LiftedMatch],
    motions: usize,
    extent_m: f64,
    rng: &mut impl Rng,
) -> Vec<Proposal> {
    let gate = Gate::new(extent_m);
    let mut pool: Vec<LiftedMatch> = matches.iter().filter(|m| gate.has_moved(m)).copied().collect();
    let mut proposals: Vec<Proposal> = Vec::new();
    // Rejected motions also use up an attempt, so the loop ends.
    for _ in 0..2 * (motions + SPARE) {
        if proposals.len() >= motions + SPARE {
            break;
        }
        let Some(proposal) = strongest_motion(&pool, extent_m, rng) else { break };
        let before = pool.len();
        // Also if the motion is not proposed: its matches would give it again.
        pool.retain(|m| !gate.supports(m, &proposal.state1_from_state0));
        let slack = proposal.displacement_m < SLACK * MOVED * extent_m;
        let mut stronger = proposals.iter().filter(|p| proposal.support < TWIN_SUPPORT * p.support);
        let motion = &proposal.state1_from_state0;
        if !slack && !stronger.any(|p| is_twin(motion, &p.state1_from_state0, matches, &gate, extent_m)) {
            proposals.push(proposal);
        }
        // The next attempt would see the same matches.
        if pool.len() == before {
            break;
        }
    }
    proposals.sort_by(|a, b| b.support.total_cmp(&a.support));
    proposals
}

/// Up to `count` motions of all matches, static ones included; each comes from the matches that earlier ones
/// left.
pub(crate) fn common_motions(
    matches: &[LiftedMatch],
    count: usize,
    extent_m: f64,
    rng: &mut impl Rng,
) -> Vec<Pose> {
    let gate = Gate::new(extent_m);
    let mut pool = matches.to_vec();
    let mut found: Vec<Pose> = Vec::new();
    for _ in 0..2 * count {
        let Some(proposal) = strongest_motion(&pool, extent_m, rng).filter(|_| found.len() < count) else {
            break;
        };
        pool.retain(|m| !gate.supports(m, &proposal.state1_from_state0));
        if !found.iter().any(|f| is_twin(&proposal.state1_from_state0, f, matches, &gate, extent_m)) {
            found.push(proposal.state1_from_state0);
        }
    }
    found
}

/// Whether the weaker of two motions is the stronger one found again from badly placed matches: where it
/// acts, it differs by less than [`TWIN_GATES`] gates, and it acts in the midst of the stronger's matches.
/// (Two parts with similar motions are side by side.)
fn is_twin(weak: &Pose, strong: &Pose, matches: &[LiftedMatch], gate: &Gate, extent_m: f64) -> bool {
    let [followers, others]: [Vec<&LiftedMatch>; 2] =
        [weak, strong].map(|motion| matches.iter().filter(|m| gate.supports(m, motion)).collect());
    // Compared where the motions act: two turns about far axes may differ much elsewhere and be one here.
    let twins = followers.iter().filter(|m| {
        let close = (weak * m.point0 - strong * m.point0).norm() < TWIN_GATES * gate.most_m;
        close && others.iter().any(|o| (o.point0 - m.point0).norm() < TWIN_DISTANCE * extent_m)
    });
    2 * twins.count() > followers.len()
}

/// Side of the cells in which support is counted, meters, for an object with a longest side of `extent_m`.
pub(crate) fn cell_side_m(extent_m: f64) -> f64 {
    CELL * extent_m
}

/// Compact cell indices of points.
fn cell_numbers(points: impl Iterator<Item = Point3<f64>>, cell_m: f64) -> (Vec<usize>, usize) {
    let mut ids = BTreeMap::new();
    let cells = points
        .map(|p| {
            let next = ids.len();
            *ids.entry([0, 1, 2].map(|k| (p[k] / cell_m).floor() as i64)).or_insert(next)
        })
        .collect();
    (cells, ids.len())
}

/// Sums the support of motions over the cells of both states.
pub(crate) struct CellCounter {
    gate: Gate,
    cells: [Vec<usize>; 2],
    best: [Vec<f32>; 2],
    touched: Vec<usize>,
}

impl CellCounter {
    pub(crate) fn new(pool: &[LiftedMatch], gate: Gate, cell_m: f64) -> Self {
        let (c0, n0) = cell_numbers(pool.iter().map(|m| m.point0), cell_m);
        let (c1, n1) = cell_numbers(pool.iter().map(|m| m.point1), cell_m);
        Self { gate, cells: [c0, c1], best: [vec![0.0; n0], vec![0.0; n1]], touched: Vec::new() }
    }

    /// Support of a motion: each cell counts by its best match, and the state with the smaller sum decides.
    pub(crate) fn support(&mut self, pool: &[LiftedMatch], motion: &Pose) -> f64 {
        let rotation = motion.rotation.to_rotation_matrix();
        let mut sums = [0.0f32; 2];
        self.touched.clear();
        for (i, m) in pool.iter().enumerate() {
            let distance = self.gate.distance_m(m.sigma_m);
            // docs/method.md (5.1) and (5.2); one rotation matrix for all matches is faster than a quaternion
            // for each.
            let squared =
                (rotation * m.point0.coords + motion.translation.vector - m.point1.coords).norm_squared();
            if squared < distance * distance {
                self.touched.push(i);
                let value = (1.0 - squared / (distance * distance)) as f32;
                for s in 0..2 {
                    let best = &mut self.best[s][self.cells[s][i]];
                    if value > *best {
                        sums[s] += value - *best;
                        *best = value;
                    }
                }
            }
        }
        // Only touched cells are cleared: each of thousands of motions touches few.
        for &i in &self.touched {
            (0..2).for_each(|s| self.best[s][self.cells[s][i]] = 0.0);
        }
        f64::from(sums[0].min(sums[1]))
    }
}

/// The motion with the most support in the pool; `None` if none has enough.
fn strongest_motion(pool: &[LiftedMatch], extent_m: f64, rng: &mut impl Rng) -> Option<Proposal> {
    if (pool.len() as f64) < LEAST_SUPPORT {
        return None;
    }
    let gate = Gate::new(extent_m);
    let mut counter = CellCounter::new(pool, gate, cell_side_m(extent_m));
    let mut best: Option<(f64, Pose)> = None;
    for trial in 0..TRIALS {
        // Small triples stay on one part, wide ones fix its rotation: all sizes take turns.
        let radius_m = extent_m * TRIPLE_RADII[trial % TRIPLE_RADII.len()];
        let Some(motion) = triple_motion(pool, radius_m, &gate, rng) else { continue };
        let support = counter.support(pool, &motion);
        if best.as_ref().is_none_or(|b| support > b.0) {
            best = Some((support, motion));
        }
    }
    // The errors of three matches enter the motion; refitting to all its matches averages them out.
    let mut motion = best?.1;
    for _ in 0..5 {
        motion = refitted_motion(pool, &motion, &gate)?;
    }
    let followers: Vec<&LiftedMatch> = pool.iter().filter(|m| gate.supports(m, &motion)).collect();
    let support = counter.support(pool, &motion);
    // Three matches fit their own motion by construction: the fourth is the first evidence for it.
    if support < LEAST_SUPPORT || followers.len() < 4 {
        return None;
    }
    let squares: f64 = followers.iter().map(|m| (motion * m.point0 - m.point1).norm_squared()).sum();
    let mut moved: Vec<f64> = followers.iter().map(|m| (m.point1 - m.point0).norm()).collect();
    moved.sort_by(f64::total_cmp);
    Some(Proposal {
        state1_from_state0: motion,
        support,
        matches: followers.len(),
        rms_m: (squares / followers.len() as f64).sqrt(),
        displacement_m: moved[9 * moved.len() / 10],
    })
}

/// The motion of three random matches within `radius_m` of the first whose mutual distances agree in both
/// states.
fn triple_motion(pool: &[LiftedMatch], radius_m: f64, gate: &Gate, rng: &mut impl Rng) -> Option<Pose> {
    let a = random_match(pool, rng);
    let mut chosen = vec![a];
    for _ in 0..2 {
        let partner = (0..24).map(|_| random_match(pool, rng)).find(|b| {
            let near = (b.point0 - a.point0).norm() < radius_m;
            near && chosen.iter().all(|m| distances_agree(m, b, gate))
        });
        chosen.push(partner?);
    }
    let motion = rigid_fit(chosen.iter().map(|m| (m.point0, m.point1, 1.0)))?;
    // Three small differences of distances may together exceed what a match allows.
    chosen.iter().all(|m| gate.supports(m, &motion)).then_some(motion)
}

fn random_match<'a>(pool: &'a [LiftedMatch], rng: &mut impl Rng) -> &'a LiftedMatch {
    &pool[((rng.next_u64() >> 32) as usize * pool.len()) >> 32]
}

/// Whether two matches could be of one rigid motion, which keeps their distance the same in both states. This
/// is cheaper to test than a fit.
fn distances_agree(p: &LiftedMatch, q: &LiftedMatch, gate: &Gate) -> bool {
    let l0 = (p.point0 - q.point0).norm();
    let l1 = (p.point1 - q.point1).norm();
    let sigma = p.sigma_m.hypot(q.sigma_m);
    // Ends closer together than their errors do not fix a rotation.
    l0 > 4.0 * sigma && (l0 - l1).abs() < gate.distance_m(sigma)
}

/// The motion refitted to its support; each match is weighted by its precision and its distance
/// (Geman-McClure). See docs/method.md (6.2).
fn refitted_motion(pool: &[LiftedMatch], motion: &Pose, gate: &Gate) -> Option<Pose> {
    let pairs = pool.iter().filter(|m| gate.supports(m, motion)).map(|m| {
        let z = (motion * m.point0 - m.point1).norm() / m.sigma_m;
        (m.point0, m.point1, (m.sigma_m * (1.0 + z * z / 4.0)).powi(-2))
    });
    rigid_fit(pairs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use numeric::random::stage_rng;

    fn uniform(rng: &mut impl Rng) -> f64 {
        (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn lifted(point0: Point3<f64>, point1: Point3<f64>, sigma_m: f64) -> LiftedMatch {
        LiftedMatch { point0, point1, sigma_m, frames: [0, 0], pixels: [[0.0; 2]; 2] }
    }

    /// Points in a box moved by each motion, with noise, and as many wrong matches.
    fn scene(motions: &[Pose], outliers: usize, seed: u64) -> Vec<LiftedMatch> {
        let mut rng = stage_rng(seed, "test", 0);
        let mut all = Vec::new();
        let mut vector =
            |s: f64, c: [f64; 3]| Vector3::from(c) + Vector3::from_fn(|_, _| s * (uniform(&mut rng) - 0.5));
        for (k, motion) in motions.iter().enumerate() {
            for _ in 0..60 {
                let p = Point3::from(vector(0.3, [0.4 * k as f64, 0.0, 0.0]));
                all.push(lifted(p, motion * p + vector(0.004, [0.0; 3]), 0.002));
            }
        }
        for _ in 0..outliers {
            all.push(lifted(
                Point3::from(vector(1.0, [0.4, 0.0, 0.0])),
                Point3::from(vector(1.0, [0.4, 0.0, 0.0])),
                0.002,
            ));
        }
        all
    }

    #[test]
    fn three_motions_among_many_wrong_matches_are_found_once_each() {
        let truth = [
            Pose::identity(),
            Pose::new(Vector3::new(0.2, 0.0, 0.1), Vector3::new(0.0, 0.6, 0.3)),
            Pose::translation(0.0, 0.2, 0.05),
            Pose::new(Vector3::new(-0.1, 0.1, 0.0), Vector3::new(0.9, 0.0, 0.0)),
        ];
        let matches = scene(&truth, 240, 1);
        for seed in 0..3 {
            let found = proposed_motions(&matches, 3, 1.5, &mut stage_rng(seed, "ransac", 0));
            assert!(found.len() >= 3, "{}", found.len());
            for (k, t) in truth.iter().enumerate().skip(1) {
                let center = Point3::new(0.4 * k as f64, 0.0, 0.0);
                let near = |p: &Proposal| {
                    (p.state1_from_state0 * center - t * center).norm() < 0.002
                        && p.state1_from_state0.rotation.angle_to(&t.rotation) < 0.01
                };
                assert_eq!(found.iter().filter(|p| near(p)).count(), 1, "motion {k}");
                assert!(found.iter().position(near).is_some_and(|i| i < 3));
            }
        }
    }

    #[test]
    fn parts_side_by_side_that_move_nearly_alike_are_two() {
        let truth = [Pose::translation(0.112, 0.0, 0.0), Pose::translation(0.125, 0.0, 0.0)];
        let found = proposed_motions(&scene(&truth, 60, 4), 2, 0.94, &mut stage_rng(0, "ransac", 0));
        for (k, t) in truth.iter().enumerate() {
            let center = Point3::new(0.4 * k as f64, 0.0, 0.0);
            let off_m = |p: &Proposal| (p.state1_from_state0 * center - t * center).norm();
            assert!(
                found.iter().map(off_m).fold(f64::INFINITY, f64::min) < 0.003,
                "motion {k} of {}",
                found.len()
            );
        }
    }

    #[test]
    fn static_matches_and_slack_propose_nothing() {
        let slack = Pose::new(Vector3::new(0.03, 0.0, 0.0), Vector3::new(0.0, 0.0, 0.01));
        let matches = scene(&[Pose::identity(), slack], 0, 2);
        assert!(proposed_motions(&matches, 2, 1.5, &mut stage_rng(0, "ransac", 0)).is_empty());
        assert!(proposed_motions(&[], 2, 1.5, &mut stage_rng(0, "ransac", 0)).is_empty());
    }

    #[test]
    fn wrong_matches_alone_propose_nothing() {
        let matches = scene(&[], 300, 3);
        assert!(proposed_motions(&matches, 2, 1.5, &mut stage_rng(0, "ransac", 0)).is_empty());
    }
}
