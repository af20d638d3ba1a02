//! The evidence that each of a set of motions, and no other, explains.

use std::collections::BTreeSet;

use crate::{
    pair::reprojection::{ASTRAY, CONTRADICTED, FREE, HIDDEN, log_ratio},
    parts::{
        labeling::labels_and_costs,
        matched_pair::MatchedPair,
        segment::{samples_by_sheet, segments_of},
    },
    propose::ransac::CHANCE,
};
use geometry::Pose;

/// Weight of a cell of explained surface relative to a cell with a match: a wrong match shows in its distance
/// in three dimensions and its look, a wrong surface only in its distance in one.
/// tuned: shared/bags
pub(crate) const SURFACE_WEIGHT: f64 = 0.16;
/// Least evidence that only a motion itself explains, in cells: the cells of its matches beyond chance, and a
/// sixth of the cells of surface that contradict the other motions.
/// tuned: shared/bags; two to three times the evidence of wrong motions between similar parts of one object
pub const LEAST_SCORE: f64 = 14.0;

/// Evidence of each motion, and the share of the surface that it alone explains; each surface belongs to one
/// part.
pub(crate) fn scores_and_shares(pair: &MatchedPair<'_>, motions: &[Pose]) -> (Vec<f64>, Vec<f64>) {
    weighed_as(pair, motions, &labels_and_costs(&pair.surfaces, motions).0)
}

/// The same with given labels.
pub(crate) fn weighed_as(
    pair: &MatchedPair<'_>,
    motions: &[Pose],
    labels: &[Vec<u8>; 2],
) -> (Vec<f64>, Vec<f64>) {
    let costs = [0, 1].map(|s| pair.surfaces.shape_costs(s, motions, Some(&labels[1 - s])));
    let scores = scores_of_motions(pair, motions, &preferred_shares(pair, motions, &costs, labels));
    (scores, explained_shares(&costs, motions.len()))
}

/// Share of the surface in favor of each motion: segment by segment, its evidence over the static part and
/// over each adjacent motion, less the samples moved into space seen empty. A segment hidden in the other
/// state is no evidence for or against a motion. See docs/method.md (7.3).
fn preferred_shares(
    pair: &MatchedPair<'_>,
    motions: &[Pose],
    costs: &[Vec<f32>; 2],
    labels: &[Vec<u8>; 2],
) -> Vec<f64> {
    let mut gains = vec![0.0; motions.len()];
    for segment in segments_of(&pair.surfaces, motions, labels) {
        let ratios = [0, 1].map(|s| {
            log_ratios(pair, s, &segment.samples[s], segment.label, &[&costs[s]], &labels[s], motions.len())
        });
        // One rival for each state, as a surface may come from behind one part and go behind another:
        // docs/method.md (7.3).
        let pairs = ratios[0].iter().flat_map(|first| ratios[1].iter().map(move |second| (first, second)));
        let possible = pairs
            .filter(|(a, b)| a.0 == b.0 || !segment.crosses(&pair.surfaces, &motions[a.0], &motions[b.0]));
        gains[segment.label] += possible.map(|(a, b)| a.1 + b.1).reduce(f64::min).unwrap_or(0.0);
    }
    let count = labels.iter().map(Vec::len).sum::<usize>();
    gains.into_iter().map(|g| g / count.max(1) as f64).collect()
}

/// Adds the evidence of the samples of one state for each motion, patch by patch. `costs` are those of their
/// reprojections into every other state.
pub(crate) fn add_preferences(
    pair: &MatchedPair<'_>,
    state: usize,
    costs: &[&[f32]],
    labels: &[u8],
    gains: &mut [f64],
) {
    for (own, samples) in samples_by_sheet(&pair.surfaces, state, labels) {
        let ratios = log_ratios(pair, state, &samples, own, costs, labels, gains.len());
        gains[own] += ratios.into_iter().map(|t| t.1).reduce(f64::min).unwrap_or(0.0);
    }
}

/// Evidence of samples of one state for their own motion over the static part and over each adjacent motion,
/// by the index of the rival.
fn log_ratios(
    pair: &MatchedPair<'_>,
    state: usize,
    samples: &[usize],
    own: usize,
    costs: &[&[f32]],
    labels: &[u8],
    motions: usize,
) -> Vec<(usize, f64)> {
    // Rivals are the static part and parts beside the segment: some motion elsewhere would fit a flat patch
    // by chance.
    let beside = samples
        .iter()
        .flat_map(|&i| pair.surfaces.neighbors_on_surface(state, i))
        .map(|j| usize::from(labels[j]));
    let others: BTreeSet<usize> = beside.chain([0]).filter(|k| *k != own).collect();
    let rows = samples.iter().flat_map(|&i| costs.iter().map(move |c| &c[i * motions..(i + 1) * motions]));
    let free = rows.clone().filter(|c| c[own] >= FREE).count() as f64;
    let reached = rows.clone().filter(|c| c[own] < HIDDEN).count() as f64;
    // Errors move some true samples into free space; only the excess over their share counts against the
    // motion.
    let lost = CONTRADICTED * (free - ASTRAY * reached).max(0.0);
    let mut ratios = Vec::with_capacity(others.len());
    for k in others {
        let total: f64 = rows.clone().map(|c| log_ratio(c[own], c[k])).sum();
        ratios.push((k, (total - lost).max(0.0)));
    }
    ratios
}

/// See [`EvidencePoint::unexplained`] and docs/method.md (7.4).
pub(crate) fn unexplained_evidence(pair: &MatchedPair<'_>, motions: &[Pose]) -> f64 {
    let costs = [0, 1].map(|s| pair.surfaces.shape_costs(s, motions, None));
    let best = costs
        .iter()
        .flat_map(|c| c.chunks_exact(motions.len()))
        .map(|row| row.iter().copied().fold(1.0, f32::min));
    let (sum, count) = best.fold((0.0, 0usize), |(sum, n), c| (sum + f64::from(c), n + 1));
    surface_evidence(pair, sum / count.max(1) as f64)
}

/// Converts a share of the surface to evidence, in cells.
pub(crate) fn surface_evidence(pair: &MatchedPair<'_>, share: f64) -> f64 {
    SURFACE_WEIGHT * share * pair.surface_cells() as f64
}

/// Evidence that each motion alone explains, in cells: the cells of its matches beyond chance, and the cells
/// of its surface, with less weight because any plane fits any other. See docs/method.md (7.1).
pub(crate) fn scores_of_motions(pair: &MatchedPair<'_>, motions: &[Pose], shares: &[f64]) -> Vec<f64> {
    let surface = pair.surface_cells();
    let matched = pair.match_cells(motions).into_iter().map(|cells| f64::max(cells - CHANCE, 0.0));
    matched.zip(shares).map(|(cells, share)| cells + SURFACE_WEIGHT * share * surface as f64).collect()
}

/// Share of all samples that each motion alone explains: the mean increase of the least cost without it. Only
/// a surface that is reached counts as an explanation.
pub(crate) fn explained_shares(costs: &[Vec<f32>; 2], motions: usize) -> Vec<f64> {
    let mut gains = vec![0.0; motions];
    for sample in costs.iter().flat_map(|c| c.chunks_exact(motions)) {
        let mut best = 1.0f32;
        let mut second = 1.0f32;
        let mut winner = 0;
        for (k, &c) in sample.iter().enumerate() {
            // Hidden and free places explain nothing, and a motion must not win by hiding samples.
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

/// Whether matches decide the motion of part `k` among those its shape allows.
pub(crate) fn is_matched(pair: &MatchedPair<'_>, motions: &[Pose], k: usize) -> bool {
    pair.match_cells(motions)[k] - CHANCE >= LEAST_SCORE
}
