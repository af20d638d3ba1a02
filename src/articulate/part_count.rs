//! Which of the proposed motions are parts: each must explain what no other does, measured on what it was not fitted to.
//!
//! The motion with the least evidence of its own is dropped, and the others take over what they can, until all that are
//! left have enough. Two motions of one part share their evidence, so that one of them goes first.

use std::{
    cmp::Ordering,
    collections::{BTreeMap, BTreeSet},
};

use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use super::{
    RegisterError,
    labeling::{FREE, HIDDEN},
    piece::{groups, pieces},
    register::{Run, occupied_cells},
    residual::unexplained,
};
use crate::geometry::Pose;

/// What a landing says for its motion where another takes the sample into space seen empty, in lost landings: one in fifty
/// true points is there by errors of depth and pose, and `ln 50` is 1.3 of the 3 nats that a landing at the edge of the reach
/// loses.
const MISSED: f64 = 1.3;
/// What a landing under another motion says against one under which the sample was hidden.
const BETTER: f64 = 0.35;
/// Cost of a sample that a motion takes into space seen empty, in landings on planes, of which a sixth counts.
pub(super) const CONTRADICTED: f64 = 2.0;
/// Share of what a motion explains that errors of depth and pose take into space seen empty.
const FREE_SHARE: f64 = 0.03;
/// Weight of a cell of explained surface against one with a match: a match to a wrong place is caught by its distance in
/// three dimensions and its look, a wrong surface by its distance in one.
pub(super) const SURFACE_WEIGHT: f64 = 0.16;
/// Cells of matches that say nothing: so many of a few hundred wrong ones follow the best of all motions by chance. Three
/// fix the motion, and where one in a thousand lands in the gate, six or seven of 300 are expected on some motion of the
/// 300^3 / 6 (number of false alarms, Moisan and Stival 2004).
pub(super) const CHANCE: f64 = 5.0;
/// Motions with less evidence than this many times the least are said to rest on little of it.
pub(super) const LITTLE: f64 = 1.5;
/// A further motion with more than this share of the least evidence is told.
const NEARLY: f64 = 0.7;
/// A set of motions with less than this share of a smaller set's evidence splits one of its parts: a further part adds to the
/// sum, a second motion of one part takes away most of that part's.
const SPLIT: f64 = 0.8;
/// A motion needs this share of the least evidence where it takes nothing from the others.
const ADDING: f64 = 0.6;
/// A part with this many times the least evidence is one even where the sum falls a little.
const FIRM: f64 = 2.2;
/// So is one that leaves less unexplained by this many times its evidence: parts that move nearly alike explain each other's
/// surface, a little off, so that what each explains alone falls.
const FITTING: f64 = 1.5;
/// A motion with less than this share of the least evidence explains next to nothing.
const SLIGHT: f64 = 0.5;
/// Rounds, at most, before motions that could all be parts are judged: surface has then gone over to the motion that it follows.
const SETTLING: usize = 8;
/// The largest sets of motions that could all be parts, which settle.
const COMPARED: usize = 2;
/// Motions that change by less than this share of the reach in a round have settled.
const SETTLED: f64 = 0.02;
/// The weakest motions that are compared before one is dropped.
const RIVALS: usize = 3;
/// Two sets of motions explain alike from this share of the better one's evidence on.
const ALIKE: f64 = 0.9;
/// Share of the surface that may move unexplained.
const UNEXPLAINED_SHARE: f64 = 0.02;

/// Evidence for a number of parts.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EvidencePoint {
    /// Number of parts, the static one included.
    pub parts: usize,
    /// What the motions explain, each alone: cells of matches, and a sixth of the cells of surface.
    pub evidence: f64,
    /// Evidence of the weakest motion and no other; none where nothing moves.
    pub weakest: Option<f64>,
    /// What is left for other motions: a sixth of the cells of surface, each by the cost of its best motion.
    pub unexplained: f64,
}

/// The motions that are parts.
pub(super) struct PartCount {
    pub motions: Vec<Pose>,
    pub curve: Vec<EvidencePoint>,
    pub notes: Vec<String>,
    pub warnings: Vec<String>,
}

/// Motions on the way from many to none.
pub(super) struct Step {
    motions: Vec<Pose>,
    point: EvidencePoint,
    /// Share of the surface that each motion explains and no other.
    shares: Vec<f64>,
    /// Whether it is a smaller set of which a motion was divided.
    divided: bool,
}

impl Run<'_> {
    /// The most motions of which each has the evidence that a part needs and none splits a part; not more than make `parts` parts, where that is
    /// given.
    pub fn choose(&self, steps: &[Step], parts: Option<usize>) -> Result<PartCount, RegisterError> {
        let least = self.config.least_score;
        let curve: Vec<EvidencePoint> = steps.iter().map(|s| s.point.clone()).collect();
        let standing = self.standing(steps, &curve);
        let allowed = |s: &&&Step| parts.is_none_or(|p| s.motions.len() <= p);
        let most = standing.iter().max_by_key(|s| s.motions.len());
        let Some(chosen) = standing.iter().filter(allowed).max_by_key(|s| s.motions.len()) else {
            return Err(RegisterError::NoOverlap { static_percent: 0.0 });
        };
        let (mut notes, mut warnings) = (Vec::new(), Vec::new());
        self.check(&chosen.motions, parts, &chosen.shares, &mut notes)?;
        let found = chosen.motions.len();
        let evident = most.map_or(found, |s| s.motions.len());
        if evident > found {
            warnings.push(more_than_asked(evident, found));
        }
        if let Some(weakest) = chosen.point.weakest.filter(|w| parts.is_none() && *w < LITTLE * least) {
            warnings.push(little_evidence(found, weakest, least));
        }
        if chosen.divided {
            notes.push(
                "parts move nearly alike: one motion explains them, a little off, and was divided where the surface calls for two".into(),
            );
        }
        let more = curve.iter().find(|p| p.parts == found + 1).and_then(|p| p.weakest);
        if let Some(weakest) = more.filter(|w| parts.is_none() && *w > NEARLY * least) {
            notes.push(format!("a further motion has {weakest:.1} of the {least} cells of evidence that a part needs"));
        }
        Ok(PartCount { motions: chosen.motions.clone(), curve, notes, warnings })
    }

    /// The most motions of which each has the evidence that a part needs.
    pub fn best(&self, steps: &[Step]) -> Vec<Pose> {
        let curve: Vec<EvidencePoint> = steps.iter().map(|s| s.point.clone()).collect();
        let most = self.standing(steps, &curve).into_iter().max_by_key(|s| s.motions.len());
        most.map_or_else(|| vec![Pose::identity()], |s| s.motions.clone())
    }

    /// The sets that stand by a curve of evidence; divided ones were judged as they were made.
    fn standing<'s>(&self, steps: &'s [Step], curve: &[EvidencePoint]) -> Vec<&'s Step> {
        steps.iter().zip(curve).filter(|(s, point)| s.divided || self.stands(point, curve)).map(|(s, _)| s).collect()
    }

    /// Whether each of a set of motions has the evidence that a part needs and none splits a part.
    fn stands(&self, point: &EvidencePoint, curve: &[EvidencePoint]) -> bool {
        let least = self.config.least_score;
        point.weakest.is_none_or(|w| w >= least || (w >= ADDING * least && adds(point, curve))) && !splits(point, curve, FIRM * least)
    }

    /// Sets of motions, each without the weakest of the one before and refitted to what the others take over, down to the
    /// static part alone.
    pub fn steps(&self, mut motions: Vec<Pose>) -> Vec<Step> {
        let mut steps = Vec::new();
        let mut settled = 0;
        loop {
            while self.thin(&mut motions) {
                self.round(&mut motions);
            }
            let (mut scores, mut shares) = self.weighed(&motions);
            if settled < COMPARED && scores[1..].iter().all(|s| *s >= SLIGHT * self.config.least_score) {
                settled += 1;
                self.settle(&mut motions);
                (scores, shares) = self.weighed(&motions);
            }
            let point = EvidencePoint { unexplained: self.unexplained(&motions), ..point(&scores) };
            steps.push(Step { motions: motions.clone(), point, shares, divided: false });
            if motions.len() == 1 {
                return steps;
            }
            motions = self.without_least(&motions, &scores);
        }
    }

    /// Adds sets in which motions are divided, as far as two motions explain clearly more than one. They begin with the best set
    /// in which no motion loses evidence to another, and come before others of as many motions that leave more unexplained.
    pub fn divide(&self, steps: &mut Vec<Step>) {
        let blind: Vec<EvidencePoint> = steps.iter().map(|s| EvidencePoint { unexplained: 0.0, ..s.point }).collect();
        let most = self.standing(steps, &blind).into_iter().max_by_key(|s| s.motions.len());
        let mut motions = most.map_or_else(Vec::new, |s| s.motions.clone());
        while let Some(divided) = self.divided(&motions) {
            let (scores, shares) = self.weighed(&divided);
            let point = EvidencePoint { unexplained: self.unexplained(&divided), ..point(&scores) };
            if steps.iter().any(|s| s.point.parts == point.parts && s.point.unexplained < point.unexplained) {
                break;
            }
            motions.clone_from(&divided);
            steps.retain(|s| s.point.parts != point.parts);
            steps.push(Step { motions: divided, point, shares, divided: true });
        }
        steps.sort_by_key(|s| std::cmp::Reverse(s.point.parts));
    }

    /// Rounds until no motion changes.
    pub fn settle(&self, motions: &mut [Pose]) {
        let points = &self.evidence.samples[0].points;
        let every = points.len().div_ceil(200);
        for _ in 0..SETTLING {
            let before = motions.to_vec();
            self.round(motions);
            let change_m = |(a, b): (&Pose, &Pose)| points.iter().step_by(every).map(|p| (a * p - b * p).norm()).fold(0.0, f64::max);
            if before.iter().zip(motions.iter()).map(change_m).all(|m| m < SETTLED * self.evidence.reach_m) {
                break;
            }
        }
    }

    /// All motions but the one of the weakest without which the others explain most, refitted; where that hardly differs, but
    /// the one without which, refitted, most others have the evidence that a part needs. Matches to a wrong place do not come in
    /// numbers: motions that have the least evidence in matches alone go last.
    fn without_least(&self, motions: &[Pose], scores: &[f64]) -> Vec<Pose> {
        let least = self.config.least_score;
        let matched = self.match_cells(motions);
        let told = |k: usize| matched[k] - CHANCE >= least;
        let mut weakest: Vec<usize> = (1..motions.len()).collect();
        weakest.sort_by(|&a, &b| told(a).cmp(&told(b)).then(scores[a].total_cmp(&scores[b])));
        let untold = weakest.iter().filter(|k| !told(**k)).count();
        // One that explains next to nothing needs no comparison, unless another explains the same.
        let next_to_nothing = |k: &usize| scores[*k] < SLIGHT * least;
        let clear = next_to_nothing(&weakest[0]) && !weakest.get(1).is_some_and(next_to_nothing);
        let rivals = if untold > 0 { untold.min(RIVALS) } else { RIVALS };
        weakest.truncate(if clear { 1 } else { rivals });
        let refitted = |mut others: Vec<Pose>| {
            self.round(&mut others);
            others
        };
        let mut rest: Vec<(f64, Vec<Pose>)> = weakest.into_iter().map(|k| (0.0, without(motions, k))).collect();
        if rest.len() > 1 {
            rest.iter_mut().for_each(|(evidence, others)| *evidence = point(&self.weighed(others).0).evidence);
            rest.sort_by(|a, b| b.0.total_cmp(&a.0));
            let alike = ALIKE * rest[0].0;
            rest.retain(|r| r.0 >= alike);
        }
        if rest.len() == 1 {
            return refitted(rest.swap_remove(0).1);
        }
        let judged = rest.into_iter().map(|(_, others)| {
            let others = refitted(others);
            let scores = self.weighed(&others).0;
            let standing = scores[1..].iter().filter(|s| **s >= least).count();
            let told: f64 = self.match_cells(&others).iter().map(|c| (c - CHANCE).max(0.0)).sum();
            (standing, told, point(&scores).evidence, others)
        });
        type Judged = (usize, f64, f64, Vec<Pose>);
        let by_matches = |a: &Judged, b: &Judged| if (a.1 - b.1).abs() > CHANCE { a.1.total_cmp(&b.1) } else { Ordering::Equal };
        let better = |a: &Judged, b: &Judged| a.0.cmp(&b.0).then(by_matches(a, b)).then(a.2.total_cmp(&b.2));
        judged.reduce(|a, b| if better(&b, &a).is_gt() { b } else { a }).map_or_else(Vec::new, |best| best.3)
    }

    /// Evidence of each motion and share of the surface that it explains and no other, each surface belonging to one part.
    pub fn weighed(&self, motions: &[Pose]) -> (Vec<f64>, Vec<f64>) {
        self.weighed_as(motions, &self.labels(motions).0)
    }

    /// The same where the labels are known.
    pub fn weighed_as(&self, motions: &[Pose], labels: &[Vec<u8>; 2]) -> (Vec<f64>, Vec<f64>) {
        let costs = [0, 1].map(|s| self.evidence.shape_costs(s, motions, Some(&labels[1 - s])));
        let scores = self.scores(motions, &self.preferred(motions, &costs, labels));
        (scores, shares(&costs, motions.len()))
    }

    /// Drops motions that have less than the least evidence even where a surface that the other state hid counts as one
    /// that is missing there, the weakest first; false where there are none.
    fn thin(&self, motions: &mut Vec<Pose>) -> bool {
        let before = motions.len();
        let mut costs = [0, 1].map(|s| self.evidence.shape_costs(s, motions, None));
        while motions.len() > 1 {
            let scores = self.scores(motions, &shares(&costs, motions.len()));
            let weakest = (1..motions.len()).min_by(|&a, &b| scores[a].total_cmp(&scores[b]));
            let Some(k) = weakest.filter(|&k| MISSED * scores[k] < self.config.least_score) else { break };
            let count = motions.len();
            motions.remove(k);
            for c in &mut costs {
                *c = c.chunks_exact(count).flat_map(|row| row.iter().enumerate().filter(|(i, _)| *i != k).map(|(_, c)| *c)).collect();
            }
        }
        motions.len() < before
    }

    /// Refuses what the motions that are left do not explain.
    fn check(&self, motions: &[Pose], parts: Option<usize>, shares: &[f64], notes: &mut Vec<String>) -> Result<(), RegisterError> {
        let static_percent = 100.0 * shares[0];
        let one = motions.len() == 1;
        if shares[0] < self.config.least_static_share {
            return Err(RegisterError::NoOverlap { static_percent });
        }
        let (found, moving) = (motions.len(), motions.len() - 1);
        match parts {
            Some(_) if one => Err(RegisterError::NoMotion { static_percent }),
            Some(asked) if asked > found => {
                let support: Vec<String> = shares.iter().skip(1).map(|s| format!("{:.1} % of the surface", 100.0 * s)).collect();
                Err(RegisterError::FewerParts { asked, found, moving, support: support.join(", ") })
            }
            _ => {
                let moved = unexplained(&self.evidence, motions);
                let of = |s: usize| moved[s].iter().filter(|m| **m).count() as f64 / moved[s].len().max(1) as f64;
                let moved_percent = 100.0 * of(0).max(of(1));
                if one && of(0).min(of(1)) > UNEXPLAINED_SHARE {
                    return Err(RegisterError::Unexplained { moved_percent });
                }
                if one {
                    notes.push(format!(
                        "no part moved: {static_percent:.0} % of the surface stands still and {moved_percent:.1} % left its place; the twin has one part"
                    ));
                }
                Ok(())
            }
        }
    }

    /// Share of the surface that speaks for each motion: piece by piece, what speaks for it rather than for the static part or
    /// a motion beside it, less what it takes into space seen empty. That a piece was hidden in the other state speaks for and
    /// against no motion.
    fn preferred(&self, motions: &[Pose], costs: &[Vec<f32>; 2], labels: &[Vec<u8>; 2]) -> Vec<f64> {
        let mut gains = vec![0.0; motions.len()];
        for piece in pieces(&self.evidence, motions, labels) {
            let told = [0, 1].map(|s| self.told(s, &piece.samples[s], piece.label, &[&costs[s]], &labels[s], motions.len()));
            let pairs = told[0].iter().flat_map(|first| told[1].iter().map(move |second| (first, second)));
            let possible = pairs.filter(|(a, b)| a.0 == b.0 || !piece.crosses(&self.evidence, &motions[a.0], &motions[b.0]));
            gains[piece.label] += possible.map(|(a, b)| a.1 + b.1).reduce(f64::min).unwrap_or(0.0);
        }
        let count = labels.iter().map(Vec::len).sum::<usize>();
        gains.into_iter().map(|g| g / count.max(1) as f64).collect()
    }

    /// Adds what the samples of one state say for each motion, patch by patch. They have `costs` for every state in which they
    /// land.
    pub fn prefer(&self, state: usize, costs: &[&[f32]], labels: &[u8], gains: &mut [f64]) {
        for (own, samples) in groups(&self.evidence, state, labels) {
            let told = self.told(state, &samples, own, costs, labels, gains.len());
            gains[own] += told.into_iter().map(|t| t.1).reduce(f64::min).unwrap_or(0.0);
        }
    }

    /// What samples of one state say for their own motion rather than for the static part and each motion beside them.
    fn told(&self, state: usize, samples: &[usize], own: usize, costs: &[&[f32]], labels: &[u8], motions: usize) -> Vec<(usize, f64)> {
        let beside = samples.iter().flat_map(|&i| self.evidence.beside(state, i)).map(|j| usize::from(labels[j]));
        let others: BTreeSet<usize> = beside.chain([0]).filter(|k| *k != own).collect();
        let landings = || samples.iter().flat_map(|&i| costs.iter().map(move |c| &c[i * motions..(i + 1) * motions]));
        let count = |holds: fn(f32) -> bool| landings().filter(|c| holds(c[own])).count() as f64;
        let lost = CONTRADICTED * (count(|c| c >= FREE) - FREE_SHARE * count(|c| c < HIDDEN)).max(0.0);
        let total = |k: usize| landings().map(|c| preference(c[own], c[k])).sum::<f64>();
        others.into_iter().map(|k| (k, (total(k) - lost).max(0.0))).collect()
    }

    /// Cells of the matches that follow each motion, every cell by the match that most prefers it to all other motions; the
    /// state with fewer decides.
    pub fn match_cells(&self, motions: &[Pose]) -> Vec<f64> {
        let cell_m = self.config.ransac.cell * self.extent_m;
        let cell = |p: &Point3<f64>| [p.x, p.y, p.z].map(|x| (x / cell_m).floor() as i64);
        let mut best: Vec<[BTreeMap<[i64; 3], f64>; 2]> = motions.iter().map(|_| Default::default()).collect();
        for m in self.telling.iter().filter(|m| self.gate.has_moved(m)) {
            let (mut first, mut second, mut follows) = (0.0, 0.0, 0);
            for (k, motion) in motions.iter().enumerate() {
                let support = self.gate.support(m, motion);
                if support > first {
                    (second, first, follows) = (first, support, k);
                } else {
                    second = f64::max(second, support);
                }
            }
            for (cells, point) in best[follows].iter_mut().zip([&m.point0, &m.point1]) {
                let value = cells.entry(cell(point)).or_default();
                *value = value.max(first - second);
            }
        }
        let sum = |cells: &BTreeMap<[i64; 3], f64>| cells.values().sum::<f64>();
        best.iter().map(|[a, b]| sum(a).min(sum(b))).collect()
    }

    /// See [`EvidencePoint::unexplained`].
    fn unexplained(&self, motions: &[Pose]) -> f64 {
        let costs = [0, 1].map(|s| self.evidence.shape_costs(s, motions, None));
        let best = costs.iter().flat_map(|c| c.chunks_exact(motions.len())).map(|row| row.iter().copied().fold(1.0, f32::min));
        let (sum, count) = best.fold((0.0, 0usize), |(sum, n), c| (sum + f64::from(c), n + 1));
        self.surface_evidence(sum / count.max(1) as f64)
    }

    /// A share of the surface as evidence, in cells.
    pub fn surface_evidence(&self, share: f64) -> f64 {
        SURFACE_WEIGHT * share * self.surface_cells() as f64
    }

    /// Cells of the surface of both states.
    fn surface_cells(&self) -> usize {
        let cell_m = self.config.ransac.cell * self.extent_m;
        self.evidence.samples.iter().map(|s| occupied_cells(&s.points, cell_m)).sum()
    }

    /// What speaks for each motion and no other, in cells: those of the matches that follow it beyond chance, and the cells of surface
    /// that it explains, which weigh less because a plane explains any other.
    fn scores(&self, motions: &[Pose], shares: &[f64]) -> Vec<f64> {
        let surface = self.surface_cells();
        let score = |(cells, share): (f64, &f64)| {
            let cells = f64::max(cells - CHANCE, 0.0);
            cells + SURFACE_WEIGHT * share * surface as f64
        };
        self.match_cells(motions).into_iter().zip(shares).map(score).collect()
    }
}

/// Says that fewer parts were asked for than there is evidence for.
pub(super) fn more_than_asked(evident: usize, asked: usize) -> String {
    format!("the evidence is for {evident} parts, {asked} were asked for")
}

/// Says that the weakest of some parts has little more evidence than the least.
pub(super) fn little_evidence(parts: usize, weakest: f64, least: f64) -> String {
    format!("one of the {parts} parts rests on little evidence: {weakest:.0} cells, where {:.0} leave no doubt", LITTLE * least)
}

/// Whether a set of motions splits a part of a smaller set: two motions of one part explain the same, so that what each
/// explains alone, and with it the sum, falls. A motion of its own adds to the sum, has `firm` evidence by itself, or leaves less
/// unexplained.
fn splits(point: &EvidencePoint, curve: &[EvidencePoint], firm: f64) -> bool {
    let weakest = point.weakest.unwrap_or(f64::INFINITY);
    let fits = |p: &EvidencePoint| p.unexplained - point.unexplained >= FITTING * weakest;
    let takes = |p: &EvidencePoint| weakest < firm && point.evidence < p.evidence && !fits(p);
    let share = |p: &EvidencePoint| if fits(p) { SPLIT.powi((point.parts - p.parts) as i32) } else { SPLIT };
    next_smaller(point, curve).is_some_and(takes) || smaller(point, curve).any(|p| point.evidence < share(p) * p.evidence)
}

/// The sets of fewer motions.
fn smaller<'a>(point: &EvidencePoint, curve: &'a [EvidencePoint]) -> impl Iterator<Item = &'a EvidencePoint> {
    let parts = point.parts;
    curve.iter().filter(move |p| p.parts < parts)
}

/// The largest of these.
fn next_smaller<'a>(point: &EvidencePoint, curve: &'a [EvidencePoint]) -> Option<&'a EvidencePoint> {
    smaller(point, curve).max_by_key(|p| p.parts)
}

/// Whether the weakest motion of a set takes next to nothing from the others, of which there are some: those of the next smaller
/// set explain less than all of these by half its evidence at least. Wrong motions take from the right ones what they explain.
fn adds(point: &EvidencePoint, curve: &[EvidencePoint]) -> bool {
    next_smaller(point, curve).is_some_and(|p| p.parts > 1 && p.evidence + 0.5 * point.weakest.unwrap_or(0.0) <= point.evidence)
}

/// All motions but one.
pub(super) fn without(motions: &[Pose], k: usize) -> Vec<Pose> {
    motions.iter().enumerate().filter(|(i, _)| *i != k).map(|(_, m)| *m).collect()
}

/// The evidence of motions, the first of which is the static part's.
pub(super) fn point(scores: &[f64]) -> EvidencePoint {
    let moving = &scores[1..];
    let weakest = moving.iter().copied().reduce(f64::min);
    EvidencePoint { parts: scores.len(), evidence: moving.iter().sum(), weakest, unexplained: 0.0 }
}

/// What a sample says for the first of two motions of these costs: that it lands on a surface, where the other takes it into
/// space seen empty or lands worse.
pub(super) fn preference(own: f32, rival: f32) -> f64 {
    match (own, rival) {
        (own, rival) if own >= HIDDEN => {
            if rival < HIDDEN {
                -BETTER
            } else {
                0.0
            }
        }
        (own, rival) if rival >= FREE => MISSED - f64::from(own),
        (_, rival) if rival >= HIDDEN => 0.0,
        (own, rival) => f64::from(rival - own),
    }
}

/// Share of all samples that each motion explains and no other: the mean rise of the least cost without it, where only
/// landing on a surface counts as an explanation.
pub(super) fn shares(costs: &[Vec<f32>; 2], motions: usize) -> Vec<f64> {
    let mut gains = vec![0.0; motions];
    for sample in costs.iter().flat_map(|c| c.chunks_exact(motions)) {
        let (mut best, mut second, mut winner) = (1.0f32, 1.0f32, 0);
        for (k, &c) in sample.iter().enumerate() {
            let c = if c >= HIDDEN { 1.0 } else { c };
            if c < best {
                (second, best, winner) = (best, c, k);
            } else {
                second = second.min(c);
            }
        }
        gains[winner] += f64::from(second - best);
    }
    let count = costs.iter().map(Vec::len).sum::<usize>() / motions.max(1);
    gains.into_iter().map(|g| g / count.max(1) as f64).collect()
}

#[cfg(test)]
#[path = "part_count_tests.rs"]
mod tests;

#[cfg(test)]
mod split_tests {
    use super::{EvidencePoint, adds, splits};

    #[test]
    fn a_motion_of_little_evidence_must_add_to_the_sum() {
        let point = |parts, evidence, weakest| EvidencePoint { parts, evidence, weakest, unexplained: 0.0 };
        let curve = [point(1, 0.0, None), point(2, 100.0, Some(100.0)), point(3, 150.0, Some(50.0)), point(4, 159.0, Some(10.0))];
        assert!(adds(&curve[3], &curve) && !adds(&point(4, 153.0, Some(10.0)), &curve));
        assert!(!adds(&point(2, 10.0, Some(10.0)), &curve), "nothing else is known to have moved");
    }

    #[test]
    fn a_second_motion_of_one_part_takes_its_evidence_away() {
        let point = |parts, evidence, weakest| EvidencePoint { parts, evidence, weakest, unexplained: 0.0 };
        let curve = [
            point(1, 0.0, None),
            point(2, 414.0, Some(414.0)),
            point(3, 64.0, Some(30.0)),
            point(4, 500.0, Some(60.0)),
            point(5, 495.0, Some(20.0)),
        ];
        let splits_of = |curve: &[EvidencePoint], k: usize| splits(&curve[k], curve, 35.0);
        let splits = |k: usize| splits_of(&curve, k);
        assert!(splits(2) && splits(4));
        assert!(!splits(3) && !splits(1) && !splits(0));
        // Two drawers that moved nearly alike: either motion explains both a little off, both leave less open.
        let mut alike = curve.clone();
        (0..5).for_each(|k| alike[k].unexplained = [900.0, 400.0, 380.0, 90.0, 60.0][k]);
        assert!(!splits_of(&alike, 4) && splits_of(&alike, 2));
        alike[4].unexplained = 61.0;
        assert!(splits_of(&alike, 4));
    }
}
