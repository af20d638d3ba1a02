//! Pieces of surface: the flat patches of each part, those of one state joined with those of the other on which they land.
//!
//! A rival motion must explain a piece in both states: a drawer that was pushed in stands in the way of nothing in one state,
//! a drawer pushed in less far stands in the way of nothing in the other.

use std::collections::BTreeMap;

use super::labeling::Evidence;
use crate::geometry::Pose;

/// The samples of one label on one flat patch in each state; one state may have none.
pub(super) struct Piece {
    pub label: usize,
    /// State and number of each sample.
    pub samples: Vec<(usize, usize)>,
}

/// All samples by piece. Of the patches that land on each other, those that do so most are joined, each with one.
pub(super) fn pieces(evidence: &Evidence<'_>, motions: &[Pose], labels: &[Vec<u8>; 2]) -> Vec<Piece> {
    let groups = [0, 1].map(|s| groups(evidence, s, &labels[s]));
    let of = [0, 1].map(|s| {
        let mut of = vec![0; labels[s].len()];
        groups[s].iter().enumerate().for_each(|(g, (_, samples))| samples.iter().for_each(|&i| of[i] = g));
        of
    });
    let mut landings: BTreeMap<[usize; 2], usize> = BTreeMap::new();
    for (k, motion) in motions.iter().enumerate() {
        for s in 0..2 {
            for (i, j) in evidence.partners(s, motion) {
                if usize::from(labels[s][i]) == k && usize::from(labels[1 - s][j]) == k {
                    let pair = if s == 0 { [of[0][i], of[1][j]] } else { [of[0][j], of[1][i]] };
                    *landings.entry(pair).or_default() += 1;
                }
            }
        }
    }
    let mut pairs: Vec<([usize; 2], usize)> = landings.into_iter().collect();
    pairs.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
    let mut partner = [0, 1].map(|s| vec![None; groups[s].len()]);
    for ([a, b], _) in pairs {
        if partner[0][a].is_none() && partner[1][b].is_none() {
            (partner[0][a], partner[1][b]) = (Some(b), Some(a));
        }
    }
    let tagged = |s: usize, g: usize| groups[s][g].1.iter().map(move |&i| (s, i));
    let first = (0..groups[0].len()).map(|a| {
        let there = partner[0][a].into_iter().flat_map(|b| tagged(1, b));
        Piece { label: groups[0][a].0, samples: tagged(0, a).chain(there).collect() }
    });
    let alone = (0..groups[1].len()).filter(|&b| partner[1][b].is_none());
    first.chain(alone.map(|b| Piece { label: groups[1][b].0, samples: tagged(1, b).collect() })).collect()
}

/// The samples of a state by label and patch, with the label.
fn groups(evidence: &Evidence<'_>, state: usize, labels: &[u8]) -> Vec<(usize, Vec<usize>)> {
    let mut of: BTreeMap<(u8, u32), Vec<usize>> = BTreeMap::new();
    for (i, label) in labels.iter().enumerate() {
        of.entry((*label, evidence.patch(state, i))).or_default().push(i);
    }
    of.into_iter().map(|((label, _), samples)| (usize::from(label), samples)).collect()
}
