//! Replaces several motions by one: motions of pieces of a part may have driven out the motion of the whole
//! part, which explained little alone beside them. See docs/method.md 6.7.

use crate::{
    pair::reprojection::{EXPLAINED, FREE},
    parts::{
        evidence_curve::evidence_point,
        labeling::labels_and_costs,
        matched_pair::MatchedPair,
        score::{LEAST_SCORE, scores_and_shares, unexplained_evidence, weighed_as},
        settle::settle_fully,
    },
};
use geometry::Pose;
use tracing::debug;

/// Share of another motion's surface that a motion must explain to replace it.
/// tuned: shared/bags
const REPLACED: f64 = 0.25;

/// The set after exchanging two or more motions for one of the `proposed` ones, repeated while the sum of the
/// evidence rises and each motion less leaves no more unexplained than a part's least evidence. Two like
/// parts are otherwise exchanged for one motion that takes each to the place of the other.
pub(crate) fn exchanged_set(pair: &MatchedPair<'_>, mut set: Vec<Pose>, proposed: &[Pose]) -> Vec<Pose> {
    let mut left = proposed.to_vec();
    loop {
        let found = labels_and_costs(&pair.surfaces, &set);
        let (labels, costs) = &*found;
        let evidence = evidence_point(&weighed_as(pair, &set, labels).0).evidence;
        let mut best: Option<(f64, usize, Vec<Pose>)> = None;
        for (i, motion) in left.iter().enumerate() {
            let replaced = replaced_parts(pair, &set, labels, costs, motion);
            // One for one was decided before, when motions were chosen.
            if replaced.len() < 2 {
                continue;
            }
            let mut others: Vec<Pose> =
                set.iter().enumerate().filter(|(k, _)| !replaced.contains(k)).map(|(_, m)| *m).collect();
            others.push(*motion);
            settle_fully(pair, &mut others);
            let after = evidence_point(&scores_and_shares(pair, &others).0).evidence;
            // Of equal ones the last.
            if after > evidence
                && best.as_ref().is_none_or(|b| after >= b.0)
                && unexplained_and_parts(pair, &others) <= unexplained_and_parts(pair, &set)
            {
                best = Some((after, i, others));
            }
        }
        let Some((after, i, others)) = best else { return set };
        debug!(
            before = set.len(),
            after = others.len(),
            evidence_before = evidence,
            evidence_after = after,
            "motions exchanged for one"
        );
        left.swap_remove(i);
        set = others;
    }
}

/// What a set costs, in cells: the surface that it leaves unexplained, and the least evidence of each motion.
fn unexplained_and_parts(pair: &MatchedPair<'_>, set: &[Pose]) -> f64 {
    unexplained_evidence(pair, set) + LEAST_SCORE * set.len() as f64
}

/// The moving parts of a set that a motion can replace: it explains a share of [`REPLACED`] of their moved
/// surface.
fn replaced_parts(
    pair: &MatchedPair<'_>,
    set: &[Pose],
    labels: &[Vec<u8>; 2],
    costs: &[Vec<f32>; 2],
    motion: &Pose,
) -> Vec<usize> {
    let mut counts = vec![[0usize; 2]; set.len()];
    for state in 0..2 {
        let other = pair.surfaces.shape_costs(state, &[*motion], None);
        for ((row, label), cost) in costs[state].chunks_exact(set.len()).zip(&labels[state]).zip(other) {
            let label = usize::from(*label);
            // Only surface that moved counts: the static part's motion takes it into space seen empty.
            if row[label] < EXPLAINED && row[0] >= FREE {
                counts[label][0] += 1;
                counts[label][1] += usize::from(cost < EXPLAINED);
            }
        }
    }
    (1..set.len()).filter(|&k| counts[k][1] as f64 > REPLACED * counts[k][0] as f64).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, UnitQuaternion, Vector3};

    use super::*;
    use crate::samples::synthetic::Scene;

    #[test]
    fn one_motion_takes_the_place_of_two_that_each_explain_a_piece() {
        let scene = Scene { texture: 0.0, ..Scene::lamp() };
        // The arm's lower and upper half, each turned end for end.
        let halves = [0.11, 0.25].map(|z| {
            let middle = Vector3::new(0.0, 0.0, z);
            let half = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::PI);
            scene.truth(1) * Pose::from_parts((middle - half * middle).into(), half)
        });
        let right = vec![Pose::identity(), scene.truth(1), scene.truth(2)];
        scene.seen(0.006, 0.012, |surfaces, _| {
            let pair = MatchedPair::new(&[], 0.4, surfaces);
            let found = exchanged_set(
                &pair,
                vec![Pose::identity(), halves[0], halves[1], scene.truth(2)],
                &[scene.truth(1)],
            );
            assert_eq!(found.len(), 3);
            let end = Point3::new(0.0, 0.0, 0.31);
            assert!(found.iter().any(|m| (m * end - scene.truth(1) * end).norm() < 0.01));
            assert_eq!(exchanged_set(&pair, right.clone(), &halves), right);
        });
    }
}
