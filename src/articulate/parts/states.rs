//! Parts of an object in several states: the common refinement of the labels of state 0's surface over all
//! pairs of states. See docs/method.md 7.4.
//!
//! State 0 is registered with every other state. Two points of its surface are of one part if they are so in
//! every pair: a part at rest in a pair is one with its parent there. Each of the common parts must explain
//! surface that no other explains, by the same rule as for one pair; the rest goes to the best other part.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use tracing::debug;

use crate::{
    observations::{LiftedMatch, SurfaceSamples},
    pair::{
        point_to_plane::refined_motion,
        reprojection::log_ratio,
        surface_pair::{FreeSpace, SurfacePair},
        unexplained::LEAST_SHARE,
    },
    parts::{
        error::RegisterError,
        evidence_curve::{EvidencePoint, evidence_point, is_standing},
        matched_pair::MatchedPair,
        part_count::{LITTLE, little_evidence, more_than_asked},
        register::{Registration, checked_extent_m},
        registrar::LAST_REACH,
        score::{LEAST_SCORE, SURFACE_WEIGHT, add_preferences},
    },
    propose::ransac::CHANCE,
    samples::{
        spacing::{occupied_cells, reach_m},
        surface_graph::Of,
    },
};
use common::note::{Note, NoteCode};
use geometry::{Pose, Screw};

/// Largest number of parts.
const MOST: usize = 32;
/// Rounds of alternating labels and motions once the parts are known.
const ROUNDS: usize = 2;
/// Range, in each direction, of the search for a missed motion along the line of the part's largest one, in
/// amounts of the largest. tuned: shared/bags
const BEYOND: f64 = 1.5;
/// Steps of the search in each direction.
const STEPS: i32 = 30;
/// Number of samples tried in every step.
const TRIED: usize = 800;

/// State 0 and another one.
pub struct StatePair<'a> {
    /// Matches between them.
    pub matches: &'a [LiftedMatch],
    /// Surface of the other state.
    pub surface: &'a SurfaceSamples,
    /// Space seen empty in the other state.
    pub free: Option<FreeSpace<'a>>,
    /// Parts and motions found from these two states alone.
    pub found: &'a Registration,
}

/// Parts of all states.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct United {
    /// Motion of every part from state 0 to each other state, by state; the first part is the static one.
    pub motions: Vec<Vec<Pose>>,
    /// Part of every surface sample of each state.
    pub labels: Vec<Vec<u8>>,
    /// Evidence by number of parts, most parts first.
    pub curve: Vec<EvidencePoint>,
    /// Sentences about the choice.
    pub notes: Vec<Note>,
    /// Sentences about weak evidence.
    pub warnings: Vec<Note>,
}

/// A part over all pairs.
#[derive(Clone, Debug)]
struct Class {
    /// Its label in each pair; [`FOUND`] where its motion was found afterwards.
    labels: Vec<u8>,
    /// Its motion in each pair.
    motions: Vec<Pose>,
}

/// Marks a motion that the pair alone did not show.
const FOUND: u8 = u8::MAX;

/// All combinations of labels that points have in the given labelings, each with its number of points: the
/// all-zero combination first, then the most frequent first.
pub(crate) fn common_refinement(labelings: &[&[u8]]) -> Vec<(Vec<u8>, usize)> {
    let points = labelings.iter().map(|l| l.len()).min().unwrap_or(0);
    let mut counts: BTreeMap<Vec<u8>, usize> = BTreeMap::from([(vec![0; labelings.len()], 0)]);
    for i in 0..points {
        *counts.entry(labelings.iter().map(|l| l[i]).collect()).or_default() += 1;
    }
    let mut classes: Vec<(Vec<u8>, usize)> = counts.into_iter().collect();
    // A stable sort: classes of equal size stay in the order of their labels.
    classes.sort_by_key(|(labels, count)| (labels.iter().any(|l| *l != 0), usize::MAX - count));
    classes
}

/// Combines the parts and motions of the pairs into those of all states. `surface` and `free` are the samples
/// and the empty space of state 0; `parts` is the number of parts, if given.
///
/// # Errors
/// If there are fewer parts than asked for.
pub fn unite<'a>(
    surface: &'a SurfaceSamples,
    free: Option<FreeSpace<'a>>,
    pairs: &[StatePair<'a>],
    parts: Option<usize>,
) -> Result<United, RegisterError> {
    let all: Vec<&SurfaceSamples> = std::iter::once(surface).chain(pairs.iter().map(|p| p.surface)).collect();
    let extent_m = checked_extent_m(&all, parts)?;
    let mut runs = Vec::with_capacity(pairs.len());
    for pair in pairs {
        let both = [surface, pair.surface];
        // The pairs' motions are refined already, so the last reach applies.
        let reach_m = reach_m(both, LAST_REACH * extent_m);
        let surfaces = SurfacePair::new(both, [free, pair.free], reach_m);
        runs.push(MatchedPair::new(pair.matches, extent_m, surfaces));
    }
    let states = States { runs };
    let sets = states.thinned_sets(common_parts(pairs, surface.points.len()));
    // Sets of parts stand by the same rule as for a pair.
    let curve: Vec<EvidencePoint> = sets.iter().map(|s| evidence_point(&s.scores)).collect();
    let standing = sets.iter().zip(&curve).filter(|(_, p)| is_standing(p, &curve));
    let evident = standing.clone().map(|(s, _)| s.classes.len()).max();
    let mut standing = standing.map(|(s, _)| s);
    let Some(chosen) = standing.find(|s| parts.is_none_or(|p| s.classes.len() <= p)) else {
        return Err(RegisterError::NoOverlap { static_percent: 0.0 });
    };
    let ClassSet { mut classes, scores } = chosen.clone();
    debug!(parts = classes.len(), evident, asked = parts, evidence_cells = ?scores, "parts of all states");
    let mut notes = Vec::new();
    let mut warnings = Vec::new();
    if let Some(evident) = evident.filter(|e| *e > classes.len()) {
        warnings.push(more_than_asked(evident, classes.len()));
    }
    if let Some(asked) = parts.filter(|p| *p > classes.len()) {
        let support = scores[1..].iter().map(|s| format!("{s:.0} cells")).collect::<Vec<_>>().join(", ");
        return Err(RegisterError::FewerParts {
            asked,
            found: classes.len(),
            moving: classes.len() - 1,
            support,
        });
    }
    let weakest = scores[1..].iter().copied().reduce(f64::min);
    if let Some(score) = weakest.filter(|s| parts.is_none() && *s < LITTLE * LEAST_SCORE) {
        warnings.push(little_evidence(classes.len(), score));
    }
    // A missed motion is looked for where a part seems at rest.
    states.seek_missed(&mut classes, &mut notes);
    for _ in 0..ROUNDS {
        states.settle_once(&mut classes);
    }
    let labels = states.labels_of_states(&classes, Of::AllParts);
    let motions = (0..pairs.len()).map(|k| motions_in_pair(&classes, k)).collect();
    Ok(United { motions, labels, curve, notes, warnings })
}

/// The common parts of all pairs, without those too small to stand.
fn common_parts(pairs: &[StatePair], samples: usize) -> Vec<Class> {
    let labelings: Vec<&[u8]> = pairs.iter().map(|p| p.found.labels[0].as_slice()).collect();
    let least = LEAST_SHARE * samples as f64;
    let mut refinement = common_refinement(&labelings);
    refinement.retain(|(labels, count)| labels.iter().all(|l| *l == 0) || *count as f64 >= least);
    let mut classes = Vec::new();
    for (labels, _) in refinement.into_iter().take(MOST) {
        let motions = labels.iter().zip(pairs).map(|(l, p)| p.found.motions[usize::from(*l)]).collect();
        classes.push(Class { labels, motions });
    }
    classes
}

/// Motions of all parts in a pair, from state 0.
fn motions_in_pair(classes: &[Class], pair: usize) -> Vec<Pose> {
    classes.iter().map(|c| c.motions[pair]).collect()
}

/// A set of parts with the evidence for each, in cells.
#[derive(Clone)]
struct ClassSet {
    classes: Vec<Class>,
    scores: Vec<f64>,
}

/// All pairs of states, prepared for search.
struct States<'a> {
    runs: Vec<MatchedPair<'a>>,
}

impl States<'_> {
    /// Part of every surface sample of each state; in state 0 the evidence of all pairs together decides.
    fn labels_of_states(&self, classes: &[Class], of: Of) -> Vec<Vec<u8>> {
        let first = self.labels_0(classes, None, of);
        let mut others = self.other_labels(classes, &first, of);
        // Repeated with the other states' labels known to state 0: a surface belongs to one part only.
        let zero = self.labels_0(classes, Some(&others), of);
        others = self.other_labels(classes, &zero, of);
        std::iter::once(zero).chain(others).collect()
    }

    fn labels_0(&self, classes: &[Class], others: Option<&[Vec<u8>]>, of: Of) -> Vec<u8> {
        let mut sum: Vec<f32> = Vec::new();
        for (k, run) in self.runs.iter().enumerate() {
            // The costs that rule a label out hold for one pair only and do not add up, so they are not used
            // here.
            let costs = run.surfaces.costs(0, &motions_in_pair(classes, k), others.map(|o| o[k].as_slice()));
            // Pairs are independent observations of the sample: their log likelihoods add up.
            if sum.is_empty() { sum = costs } else { sum.iter_mut().zip(costs).for_each(|(s, c)| *s += c) }
        }
        self.runs
            .first()
            .map_or_else(Vec::new, |run| run.surfaces.smoothed_labels(0, &sum, classes.len(), of))
    }

    /// Labels of the other states. Parts with one motion in a pair differ by their place in state 0.
    fn other_labels(&self, classes: &[Class], zero: &[u8], of: Of) -> Vec<Vec<u8>> {
        let mut labels = Vec::with_capacity(self.runs.len());
        for (k, run) in self.runs.iter().enumerate() {
            let costs = run.surfaces.label_costs(1, &motions_in_pair(classes, k), Some(zero), of);
            labels.push(run.surfaces.smoothed_labels(1, &costs, classes.len(), of));
        }
        labels
    }

    /// Sets of parts, each the one before without the part of least evidence, down to the static part.
    fn thinned_sets(&self, mut classes: Vec<Class>) -> Vec<ClassSet> {
        let mut sets = Vec::new();
        loop {
            let scores = self.evidence_of_parts(&classes);
            // Of equal ones the later is dropped: it has fewer samples.
            let weakest = (1..scores.len()).min_by(|&a, &b| scores[a].total_cmp(&scores[b]).then(b.cmp(&a)));
            sets.push(ClassSet { classes: classes.clone(), scores });
            let Some(k) = weakest else { return sets };
            classes.remove(k);
        }
    }

    /// Evidence that each part alone explains, in cells: its matches beyond chance and its surface, over all
    /// pairs.
    fn evidence_of_parts(&self, classes: &[Class]) -> Vec<f64> {
        let labels = self.labels_of_states(classes, Of::SomeParts);
        let mut scores = vec![0.0; classes.len()];
        let mut zero: Vec<Vec<f32>> = Vec::new();
        for (k, run) in self.runs.iter().enumerate() {
            let motions = motions_in_pair(classes, k);
            let mut costs = [0, 1].map(|s| {
                let others = if s == 0 { &labels[k + 1] } else { &labels[0] };
                run.surfaces.shape_costs(s, &motions, Some(others))
            });
            // Otherwise a pair in which two parts share a motion would be evidence against both.
            costs.iter_mut().for_each(|c| share_alike(c, &motions));
            let [first, second] = costs;
            zero.push(first);
            add_surface_evidence(run, 1, &[&second], &labels[k + 1], &mut scores);
        }
        if let Some(run) = self.runs.first() {
            let costs: Vec<&[f32]> = zero.iter().map(Vec::as_slice).collect();
            add_surface_evidence(run, 0, &costs, &labels[0], &mut scores);
        }
        for (k, run) in self.runs.iter().enumerate() {
            let cells = run.match_cells(&motions_in_pair(classes, k));
            scores.iter_mut().zip(cells).for_each(|(s, c)| *s += (c - CHANCE).max(0.0));
            // Keeping the reprojections of all pairs would take too much memory.
            run.surfaces.forget_results();
        }
        scores
    }

    /// One round: labels, then each part's own motion.
    fn settle_once(&self, classes: &mut [Class]) {
        let labels = self.labels_of_states(classes, Of::SomeParts);
        for (k, run) in self.runs.iter().enumerate() {
            let all = motions_in_pair(classes, k);
            let followed = run.match_labels(&all);
            for (c, class) in classes.iter_mut().enumerate().skip(1) {
                // A part at rest keeps the static part's motion; noise would otherwise separate parts that
                // share a motion.
                let own = class.labels[k] != 0 && all.iter().enumerate().all(|(i, m)| i == c || *m != all[c]);
                if !own {
                    continue;
                }
                class.motions[k] = refined_motion(
                    &run.surfaces,
                    [&labels[0], &labels[k + 1]],
                    &run.followers_of(&followed, c as u8),
                    &all[c],
                    c as u8,
                );
            }
            run.surfaces.forget_results();
        }
    }

    /// Where a pair found a part at rest, looks for a motion along the line of its motion in another pair.
    fn seek_missed(&self, classes: &mut [Class], notes: &mut Vec<Note>) {
        let labels = self.labels_of_states(classes, Of::SomeParts);
        for (c, class) in classes.iter_mut().enumerate().skip(1) {
            let own: Vec<usize> = (0..labels[0].len()).filter(|&i| usize::from(labels[0][i]) == c).collect();
            for (k, run) in
                self.runs.iter().enumerate().filter(|(k, _)| class.labels[*k] == 0).collect::<Vec<_>>()
            {
                if let Some(motion) = missed(run, &own, &class.motions) {
                    debug!(state = k + 1, part = c, "motion in a state taken from other states");
                    notes.push(Note::new(
                        NoteCode::MotionByOtherStates,
                        format!(
                            "state {}: part {c}, seen at rest there at first, moved along the axis that \
                         other states show",
                            k + 1
                        ),
                    ));
                    (class.motions[k], class.labels[k]) = (motion, FOUND);
                }
            }
        }
    }
}

/// Adds the evidence of the surface of one state; `costs` are those of its reprojections into every other
/// state.
fn add_surface_evidence(
    run: &MatchedPair<'_>,
    state: usize,
    costs: &[&[f32]],
    labels: &[u8],
    scores: &mut [f64],
) {
    let mut gains = vec![0.0; scores.len()];
    add_preferences(run, state, costs, labels, &mut gains);
    let points = &run.surfaces.samples[state].points;
    let cells = occupied_cells(points, run.cell_m()) as f64;
    for (s, g) in scores.iter_mut().zip(&gains) {
        *s += SURFACE_WEIGHT * g / points.len().max(1) as f64 * cells;
    }
}

/// The motion of a part in a pair, along the line of its largest motion in others, if its samples of state 0
/// prefer the motion to rest by at least the evidence a part needs.
fn missed(run: &MatchedPair<'_>, own: &[usize], others: &[Pose]) -> Option<Pose> {
    let samples = run.surfaces.samples[0];
    // A few samples suffice to find a step of the search; the gain is scaled up below.
    let some: Vec<usize> = own.iter().copied().step_by(own.len().div_ceil(TRIED).max(1)).collect();
    let shift_m =
        |m: &Pose| -> f64 { some.iter().map(|&i| (m * samples.points[i] - samples.points[i]).norm()).sum() };
    let largest = others.iter().max_by(|a, b| shift_m(a).total_cmp(&shift_m(b)))?;
    let screw = Screw::of_motion(largest)?;
    let cost = |i: usize, motion: &Pose| run.surfaces.shape_cost(0, i, motion).0;
    let still: Vec<f32> = some.iter().map(|&i| cost(i, &Pose::identity())).collect();
    let mut tried = Vec::new();
    for n in (-STEPS..=STEPS).filter(|n| *n != 0) {
        let step = BEYOND * f64::from(n) / f64::from(STEPS);
        let motion = screw.motion_by(step * screw.angle_rad, step * screw.advance_m);
        let gain: f64 = some.iter().zip(&still).map(|(&i, s)| log_ratio(cost(i, &motion), *s)).sum();
        tried.push((gain, motion));
    }
    let (best, motion) = tried.into_iter().reduce(|a, b| if b.0 > a.0 { b } else { a })?;
    let cells = occupied_cells(&samples.points, run.cell_m()) as f64;
    let of_all = own.len() as f64 / some.len().max(1) as f64 / samples.points.len().max(1) as f64;
    // The gain of all samples of the part as a share of the surface, in cells: docs/method.md (7.1).
    (SURFACE_WEIGHT * best * of_all * cells >= LEAST_SCORE).then_some(motion)
}

/// Gives parts with one motion the same costs: their pair cannot distinguish them.
fn share_alike(costs: &mut [f32], motions: &[Pose]) {
    let first: Vec<usize> =
        motions.iter().map(|m| motions.iter().position(|o| o == m).unwrap_or(0)).collect();
    for row in costs.chunks_exact_mut(motions.len()) {
        for k in 0..row.len() {
            row[first[k]] = row[first[k]].min(row[k]);
        }
        for k in 0..row.len() {
            row[k] = row[first[k]];
        }
    }
}

#[cfg(test)]
#[path = "states_tests.rs"]
mod tests;
