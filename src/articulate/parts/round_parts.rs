//! Parts whose shape does not show their spin about an axis; only marks on them do.

use crate::{
    parts::matched_pair::MatchedPair,
    parts::score::is_matched,
    propose::{round_part::round_turn, search::Search},
};
use geometry::Pose;
use tracing::debug;

/// The motions, with the best turn of each round part that matches do not fix; `None` if no motion changes.
pub(crate) fn turned_round(pair: &MatchedPair<'_>, motions: &[Pose]) -> Option<Vec<Pose>> {
    let mut all = motions.to_vec();
    let mut changed = false;
    for k in 1..all.len() {
        if is_matched(pair, &all, k) {
            continue;
        }
        // The other motions stay: only surface they do not explain decides the turn.
        let others = without(&all, k);
        if let Some(turned) = round_turn(&Search::new(&pair.surfaces, &others, pair.extent_m), &all[k]) {
            debug!(part = k, "round part turned about its axis");
            (all[k], changed) = (turned, true);
        }
    }
    changed.then_some(all)
}

/// All motions but one.
pub(crate) fn without(motions: &[Pose], k: usize) -> Vec<Pose> {
    motions.iter().enumerate().filter(|(i, _)| *i != k).map(|(_, m)| *m).collect()
}
