//! Sets of trials, ranked by their evidence.

use crate::camera::fit::{linear::Linear, problem::FrameProblem, reduced::Reduced};

/// Least gain of evidence for each further effect, nats.
///
/// tuned: made objects (tests/gap_frames.rs)
const NATS: f64 = 12.0;
/// Number of the best single trials used to grow the sets.
const PAIRED: usize = 8;
/// Most effects in a set.
const MOST: usize = 3;

/// The set with the highest evidence, and its rivals of the same size.
pub(super) fn best_set_and_rivals(
    problem: &FrameProblem,
    linear: &Linear,
    reduced: &[Reduced],
) -> (Vec<usize>, Vec<(Vec<usize>, f64)>) {
    let singles = (0..problem.trials.len()).map(|t| vec![t]).collect();
    let singles = ranked_sets(problem, linear, reduced, singles);
    let mut set = Vec::new();
    let mut evidence = problem.evidence_of_set(linear, reduced, &[]);
    let mut rivals = singles.clone();
    let top: Vec<usize> = singles.iter().take(PAIRED).map(|s| s.0[0]).collect();
    let mut level = singles;
    for size in 1..=MOST {
        let Some(best) = level.first().cloned() else { break };
        if best.1 - evidence < NATS {
            break;
        }
        (set, evidence) = best;
        rivals = level;
        // Larger sets grow from the best few of this size, each by one of the best single trials.
        let grown: Vec<Vec<usize>> = rivals
            .iter()
            .take(if size == 1 { PAIRED } else { 3 })
            .flat_map(|(s, _)| {
                top.iter()
                    .filter(|t| !s.contains(t))
                    .map(|t| [s.clone(), vec![*t]].concat())
                    .collect::<Vec<_>>()
            })
            .filter(|s| has_distinct_effects(problem, s))
            .map(|mut s| {
                s.sort_unstable();
                s
            })
            .collect();
        // Different sets may grow into the same one.
        let mut unique = grown;
        unique.sort();
        unique.dedup();
        level = ranked_sets(problem, linear, reduced, unique);
    }
    (set, rivals)
}

/// Sets with their evidence in nats, best first.
fn ranked_sets(
    problem: &FrameProblem,
    linear: &Linear,
    reduced: &[Reduced],
    sets: Vec<Vec<usize>>,
) -> Vec<(Vec<usize>, f64)> {
    let mut all: Vec<(Vec<usize>, f64)> = Vec::with_capacity(sets.len());
    for set in sets {
        let evidence = problem.evidence_of_set(linear, reduced, &set);
        all.push((set, evidence));
    }
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    all
}

/// Whether no two trials are variants of one effect at one joint.
fn has_distinct_effects(problem: &FrameProblem, set: &[usize]) -> bool {
    let key = |t: usize| (problem.trials[t].name, problem.trials[t].joint);
    (0..set.len()).all(|i| (0..i).all(|k| key(set[i]) != key(set[k])))
}
