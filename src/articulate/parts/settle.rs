//! Alternates labels and motions.

use crate::{
    pair::point_to_plane::refined_motion,
    parts::{labeling::labels_and_costs, matched_pair::MatchedPair},
    samples::spacing::SETTLED,
};
use geometry::Pose;

/// Largest number of rounds before possible parts are judged: surface has then moved to the label of its
/// motion.
const ROUNDS: usize = 8;
/// Number of samples from which a motion's change is measured.
const SAMPLES: usize = 200;

/// One round: labels, then every moving part's motion.
pub(crate) fn settle_once(pair: &MatchedPair<'_>, motions: &mut [Pose]) {
    // Labels of the old motions hold for the whole round, so the order of the parts does not matter.
    let found = labels_and_costs(&pair.surfaces, motions);
    let (labels, _) = &*found;
    let match_labels = pair.match_labels(motions);
    for (k, motion) in motions.iter_mut().enumerate().skip(1) {
        let followers = pair.followers_of(&match_labels, k as u8);
        *motion = refined_motion(&pair.surfaces, [&labels[0], &labels[1]], &followers, motion, k as u8);
    }
}

/// Repeats rounds until no motion changes.
pub(crate) fn settle_fully(pair: &MatchedPair<'_>, motions: &mut [Pose]) {
    let points = &pair.surfaces.samples[0].points;
    let every = points.len().div_ceil(SAMPLES);
    for _ in 0..ROUNDS {
        let before = motions.to_vec();
        settle_once(pair, motions);
        let is_settled = before.iter().zip(motions.iter()).all(|(a, b)| {
            let changes_m = points.iter().step_by(every).map(|p| (a * p - b * p).norm());
            changes_m.fold(0.0, f64::max) < SETTLED * pair.surfaces.reach_m
        });
        if is_settled {
            break;
        }
    }
}
