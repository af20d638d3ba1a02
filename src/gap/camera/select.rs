//! Which effects explain the residuals: sets of trials, judged by their evidence.

use super::{
    fit::{Chosen, GATE_M, Linear, MIDDLE, State, Work},
    kinds::mean_cost,
    mixed::Reduced,
};

/// Gain of evidence over the null that a first effect must bring, in nats.
const FIRST_NATS: f64 = 12.0;
/// Gain that a further effect must bring.
const FURTHER_NATS: f64 = 12.0;
/// Errors of the twin from which effects are followed although none explains the residuals about the null, metres.
const DOUBTFUL_M: f64 = 0.0015;
/// Growth of the mean cost of pixels with which effects are let go.
const WORSE: f64 = 1.03;
/// Effects that are followed then.
const FOLLOWED: usize = 5;
/// Trials that are combined in pairs.
const PAIRED: usize = 8;
/// Most effects together.
const MOST: usize = 3;
/// Rounds of selection and advance.
const ROUNDS: usize = 3;
/// Steps of the twin without effects, and with those chosen.
const NULL_STEPS: usize = 3;
const STEPS: usize = 2;

/// The outcome of a selection.
pub struct Selected {
    /// State with the chosen effects.
    pub state: State,
    /// State without any.
    pub null: State,
    /// The last linear system, about `state`.
    pub linear: Linear,
    /// Sizes of the errors, eliminated.
    pub reduced: Vec<Reduced>,
    /// What was chosen; an empty set where nothing was.
    pub chosen: Chosen,
    /// Evidence without effects, in the same system.
    pub null_evidence: f64,
    /// Sets of the same size that were tried, with their evidence, best first.
    pub rivals: Vec<(Vec<usize>, f64)>,
}

/// Fits the twin without effects.
pub fn settle(work: &Work, state: &mut State) {
    for i in 0..NULL_STEPS {
        work.step(state, &[], &MIDDLE, GATE_M * if i == 0 { 2.0 } else { 1.0 });
    }
}

/// Fits the twin without effects, then finds the set of effects with the most evidence.
#[must_use]
pub fn select(work: &Work, mut state: State) -> Option<Selected> {
    settle(work, &mut state);
    let null = state.clone();
    let first = rounds(work, state, &null, Vec::new())?;
    if !first.chosen.set.is_empty() || first.chosen.solution.sizes.patch_m < DOUBTFUL_M {
        return Some(first);
    }
    // The residuals are large, and no effect explains them about the null: perhaps one does where it has been followed.
    let followed = first.rivals.iter().take(FOLLOWED).filter_map(|(set, _)| {
        let mut state = null.clone();
        for _ in 0..NULL_STEPS {
            work.step(&mut state, set, &MIDDLE, GATE_M);
        }
        rounds(work, state, &null, set.clone()).filter(|s| !s.chosen.set.is_empty())
    });
    let cost = |s: &Selected| mean_cost(work, &s.state.hypothesis);
    let best = followed.map(|s| (cost(&s), s)).min_by(|a, b| a.0.total_cmp(&b.0));
    let before = mean_cost(work, &null.hypothesis);
    Some(best.filter(|b| b.0 < before).map_or(first, |b| b.1))
}

/// Searches and follows the best set, again and again.
fn rounds(work: &Work, mut state: State, null: &State, mut set: Vec<usize>) -> Option<Selected> {
    let mut selected = None;
    for round in 0..=ROUNDS {
        let mut linear = work.linearize(&state, GATE_M);
        if linear.cells.is_empty() {
            return None;
        }
        let around = work.subset(&linear, &set);
        let reduced = work.reduce_all(&mut linear, &around);
        let (mut next, null_evidence, rivals) = search(work, &linear, &reduced);
        if round == ROUNDS {
            // The last round judges what the state has.
            next.clone_from(&set);
        }
        let chosen = work.judge(&linear, &reduced, &next)?;
        let stays = next == set;
        set = next;
        let sizes = chosen.solution.sizes;
        selected = Some(Selected { state: state.clone(), null: null.clone(), linear, reduced, chosen, null_evidence, rivals });
        if stays {
            break;
        }
        let before = mean_cost(work, &state.hypothesis);
        for _ in 0..STEPS {
            work.step(&mut state, &set, &sizes, GATE_M);
        }
        if mean_cost(work, &state.hypothesis) > WORSE * before {
            // Followed, the effects explain less than the linear system promised.
            return selected.and_then(|s: Selected| {
                let chosen = work.judge(&s.linear, &s.reduced, &[])?;
                Some(Selected { state: null.clone(), chosen, ..s })
            });
        }
    }
    selected
}

/// A selection with another set of effects: followed, and judged there.
#[must_use]
pub fn with_set(work: &Work, selected: &Selected, set: &[usize]) -> Option<Selected> {
    let mut state = selected.state.clone();
    for _ in 0..STEPS {
        work.step(&mut state, set, &selected.chosen.solution.sizes, GATE_M);
    }
    let mut linear = work.linearize(&state, GATE_M);
    let around = work.subset(&linear, set);
    let reduced = work.reduce_all(&mut linear, &around);
    let chosen = work.judge(&linear, &reduced, set)?;
    let null_evidence = work.evidence(&linear, &reduced, &[]);
    Some(Selected { state, null: selected.null.clone(), linear, reduced, chosen, null_evidence, rivals: selected.rivals.clone() })
}

/// The set with the most evidence, that of no effect, and the rivals of the same size.
fn search(work: &Work, linear: &Linear, reduced: &[Reduced]) -> (Vec<usize>, f64, Vec<(Vec<usize>, f64)>) {
    let null = work.evidence(linear, reduced, &[]);
    let ranked = |sets: Vec<Vec<usize>>| {
        let mut all: Vec<(Vec<usize>, f64)> = sets
            .into_iter()
            .map(|s| {
                let evidence = work.evidence(linear, reduced, &s);
                (s, evidence)
            })
            .collect();
        all.sort_by(|a, b| b.1.total_cmp(&a.1));
        all
    };
    let singles = ranked((0..work.trials.len()).map(|t| vec![t]).collect());
    let (mut set, mut evidence, mut rivals) = (Vec::new(), null, singles.clone());
    let top: Vec<usize> = singles.iter().take(PAIRED).map(|s| s.0[0]).collect();
    let mut level = singles;
    for size in 1..=MOST {
        let needed = if size == 1 { FIRST_NATS } else { FURTHER_NATS };
        let Some(best) = level.first().cloned() else { break };
        if best.1 - evidence < needed {
            break;
        }
        (set, evidence) = best;
        rivals = level;
        // Larger sets grow from the best few of this size, with swaps by way of the pairs.
        let grown: Vec<Vec<usize>> = rivals
            .iter()
            .take(if size == 1 { PAIRED } else { 3 })
            .flat_map(|(s, _)| top.iter().filter(|t| !s.contains(t)).map(|t| [s.clone(), vec![*t]].concat()).collect::<Vec<_>>())
            .filter(|s| compatible(work, s))
            .map(|mut s| {
                s.sort_unstable();
                s
            })
            .collect();
        let mut unique = grown;
        unique.sort();
        unique.dedup();
        level = ranked(unique);
    }
    (set, null, rivals)
}

/// Whether no two trials are ways of the same effect at one joint.
fn compatible(work: &Work, set: &[usize]) -> bool {
    let key = |t: usize| (work.trials[t].name, work.trials[t].joint);
    (0..set.len()).all(|i| (0..i).all(|k| key(set[i]) != key(set[k])))
}
