//! Reduces many motions to none: the one with the least evidence of its own is dropped, and the others take
//! over its surface as far as they can. Two motions of one part share their evidence, so one of them goes
//! first. See docs/method.md 7.2.

use serde::{Deserialize, Serialize};
use tracing::debug;

use crate::{
    pair::reprojection::MISSED,
    parts::{
        evidence_curve::{EvidencePoint, evidence_point, is_standing},
        matched_pair::MatchedPair,
        round_parts::without,
        score::{LEAST_SCORE, explained_shares, scores_and_shares, scores_of_motions, unexplained_evidence},
        settle::{settle_fully, settle_once},
    },
    propose::ransac::CHANCE,
};
use geometry::Pose;

/// A motion with less than this share of the least evidence explains next to nothing.
/// tuned: shared/bags
pub(crate) const SLIGHT: f64 = 0.5;
/// Number of sets of possible parts, the largest ones, that are settled.
const COMPARED: usize = 2;
/// Number of the weakest motions compared before one is dropped.
const RIVALS: usize = 3;
/// A set of motions explains as well as a better one from this share of its evidence on.
/// tuned: shared/bags
const ALIKE: f64 = 0.9;

/// A set of motions on the way from many to none.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Step {
    pub motions: Vec<Pose>,
    pub point: EvidencePoint,
    /// Share of the surface that each motion alone explains.
    pub shares: Vec<f64>,
    /// Whether it is a smaller set in which a motion was divided.
    pub divided: bool,
}

/// The largest set of motions in which each has enough evidence for a part.
pub(crate) fn best_motions(steps: &[Step]) -> Vec<Pose> {
    // Whether a set stands depends on the smaller ones, so all are computed before one is judged.
    let curve: Vec<EvidencePoint> = steps.iter().map(|s| s.point.clone()).collect();
    let most = standing_sets(steps, &curve).into_iter().max_by_key(|s| s.motions.len());
    most.map_or_else(|| vec![Pose::identity()], |s| s.motions.clone())
}

/// The sets that stand on a curve of evidence; divided ones were judged when they were made.
pub(crate) fn standing_sets<'s>(steps: &'s [Step], curve: &[EvidencePoint]) -> Vec<&'s Step> {
    steps
        .iter()
        .zip(curve)
        .filter(|(s, point)| s.divided || is_standing(point, curve))
        .map(|(s, _)| s)
        .collect()
}

/// Sets of motions, each the refitted one before without its weakest motion, down to the static part alone.
pub(crate) fn elimination_steps(pair: &MatchedPair<'_>, mut motions: Vec<Pose>) -> Vec<Step> {
    let mut steps = Vec::new();
    let mut settled = 0;
    loop {
        // Hopeless motions go first: without them the rest needs fewer rounds.
        while drop_hopeless(pair, &mut motions) {
            settle_once(pair, &mut motions);
        }
        let (mut scores, mut shares) = scores_and_shares(pair, &motions);
        // Surface must be with its motion before large sets are compared; as rounds are slow, smaller sets do
        // without.
        if settled < COMPARED && scores[1..].iter().all(|s| *s >= SLIGHT * LEAST_SCORE) {
            settled += 1;
            settle_fully(pair, &mut motions);
            (scores, shares) = scores_and_shares(pair, &motions);
        }
        let point =
            EvidencePoint { unexplained: unexplained_evidence(pair, &motions), ..evidence_point(&scores) };
        debug!(
            parts = motions.len(),
            evidence_cells = point.evidence,
            weakest_cells = point.weakest,
            unexplained = point.unexplained,
            least_cells = LEAST_SCORE,
            "set of motions weighed"
        );
        steps.push(Step { motions: motions.clone(), point, shares, divided: false });
        if motions.len() == 1 {
            return steps;
        }
        motions = without_least(pair, &motions, &scores);
    }
}

/// Drops one of the weakest motions, the one without which the others explain most, and refits them. Where
/// sets hardly differ, the refitted set with the most standing motions is preferred. As wrong matches seldom
/// agree, motions with evidence in matches go last.
fn without_least(pair: &MatchedPair<'_>, motions: &[Pose], scores: &[f64]) -> Vec<Pose> {
    let matched = pair.match_cells(motions);
    let matched_alone = |k: usize| matched[k] - CHANCE >= LEAST_SCORE;
    let mut weakest: Vec<usize> = (1..motions.len()).collect();
    weakest.sort_by(|&a, &b| matched_alone(a).cmp(&matched_alone(b)).then(scores[a].total_cmp(&scores[b])));
    let unmatched = weakest.iter().filter(|k| !matched_alone(**k)).count();
    // A motion with next to no evidence needs no comparison, unless another explains the same.
    let slight = SLIGHT * LEAST_SCORE;
    let clear = scores[weakest[0]] < slight && weakest.get(1).is_none_or(|k| scores[*k] >= slight);
    // Motions that matches support do not compete while others are left.
    let rivals = if unmatched > 0 { unmatched.min(RIVALS) } else { RIVALS };
    weakest.truncate(if clear { 1 } else { rivals });
    debug!(weakest = ?weakest, evidence_cells = ?scores, matched_cells = ?matched, "motion dropped");
    let mut rest: Vec<(f64, Vec<Pose>)> = weakest.into_iter().map(|k| (0.0, without(motions, k))).collect();
    // Refitting is slow: only sets with similar evidence are refitted to decide.
    if rest.len() > 1 {
        rest.iter_mut().for_each(|(evidence, others)| {
            *evidence = evidence_point(&scores_and_shares(pair, others).0).evidence
        });
        rest.sort_by(|a, b| b.0.total_cmp(&a.0));
        let alike = ALIKE * rest[0].0;
        rest.retain(|r| r.0 >= alike);
    }
    if rest.len() == 1 {
        return refitted_motions(pair, rest.swap_remove(0).1);
    }
    preferred_set(
        rest.into_iter().map(|(_, others)| JudgedSet::of(pair, refitted_motions(pair, others))).collect(),
    )
}

/// Motions after a round of labels and motions.
fn refitted_motions(pair: &MatchedPair<'_>, mut motions: Vec<Pose>) -> Vec<Pose> {
    settle_once(pair, &mut motions);
    motions
}

/// A set of motions, for comparison with others of equal size.
struct JudgedSet {
    motions: Vec<Pose>,
    /// Number of motions with enough evidence for a part.
    standing: usize,
    /// Number of cells of matches beyond chance.
    matched: f64,
    /// Sum of the evidence that each motion alone explains.
    evidence: f64,
}

impl JudgedSet {
    fn of(pair: &MatchedPair<'_>, motions: Vec<Pose>) -> Self {
        let scores = scores_and_shares(pair, &motions).0;
        Self {
            standing: scores[1..].iter().filter(|s| **s >= LEAST_SCORE).count(),
            matched: pair.match_cells(&motions).iter().map(|c| (c - CHANCE).max(0.0)).sum(),
            evidence: evidence_point(&scores).evidence,
            motions,
        }
    }
}

/// The set with the most evidence, among those with the most standing motions and as much support by matches
/// as the best, up to chance. Each condition compares with the best of all, so the order of the sets does not
/// matter.
fn preferred_set(mut judged: Vec<JudgedSet>) -> Vec<Pose> {
    let standing = judged.iter().map(|j| j.standing).max();
    judged.retain(|j| Some(j.standing) == standing);
    let matched = judged.iter().map(|j| j.matched).fold(0.0, f64::max);
    judged.retain(|j| j.matched >= matched - CHANCE);
    let best = judged.into_iter().max_by(|a, b| a.evidence.total_cmp(&b.evidence));
    best.map_or_else(Vec::new, |j| j.motions)
}

/// Drops motions, the weakest first, whose evidence is too small even if a hidden surface of the other state
/// counts as a missing one; false if there are none.
fn drop_hopeless(pair: &MatchedPair<'_>, motions: &mut Vec<Pose>) -> bool {
    let before = motions.len();
    let mut costs = [0, 1].map(|s| pair.surfaces.shape_costs(s, motions, None));
    while motions.len() > 1 {
        let scores = scores_of_motions(pair, motions, &explained_shares(&costs, motions.len()));
        let weakest = (1..motions.len()).min_by(|&a, &b| scores[a].total_cmp(&scores[b]));
        // In a share a sample counts at most 1, in a preference at most `MISSED`: a motion dropped here could
        // not stand by preferences either.
        let Some(k) = weakest.filter(|&k| MISSED * scores[k] < LEAST_SCORE) else { break };
        let count = motions.len();
        debug!(motion = k, of = count - 1, evidence_cells = scores[k], "hopeless motion dropped");
        motions.remove(k);
        for c in &mut costs {
            *c = c
                .chunks_exact(count)
                .flat_map(|row| row.iter().enumerate().filter(|(i, _)| *i != k).map(|(_, c)| *c))
                .collect();
        }
    }
    motions.len() < before
}
