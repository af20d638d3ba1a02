//! Selects the effects explaining the residuals: sets of trials, judged by their evidence.
//! See docs/method.md 15.7.

use crate::camera::{
    fit::{
        components::VarianceComponents,
        cost::{SAME_COST, mean_cost},
        linear::{Chosen, Linear, State},
        problem::FrameProblem,
        reduced::Reduced,
    },
    judge::{
        follow::{FAR_STEPS, NEAR_STEPS, follow_steps, settle_without_effects},
        search::best_set_and_rivals,
    },
};

/// Number of rival sets followed if no effect is found at first.
const FOLLOWED: usize = 5;
/// Rounds of selection and steps.
const ROUNDS: usize = 3;

/// The outcome of a selection.
pub struct Selected {
    /// State with the chosen effects.
    pub state: State,
    /// State without effects.
    pub null: State,
    /// The last linear system, about `state`.
    pub linear: Linear,
    /// The reduced systems for all variance components.
    pub reduced: Vec<Reduced>,
    /// The chosen trials; an empty set if there are none.
    pub chosen: Chosen,
    /// Sets of the same size tried, with their evidence, best first.
    pub rivals: Vec<(Vec<usize>, f64)>,
}

/// Fits the twin without effects, then finds the set of effects with the highest evidence.
pub fn selected_effects(problem: &FrameProblem, mut state: State) -> Option<Selected> {
    settle_without_effects(problem, &mut state);
    let null = state.clone();
    let first = selection_rounds(problem, state, &null, Vec::new())?;
    if !first.chosen.set.is_empty() || !is_doubtful(problem, &first) {
        return Some(first);
    }
    // The residuals are large but no effect explains them to first order: one may after several steps.
    let followed = first.rivals.iter().take(FOLLOWED).filter_map(|(set, _)| {
        let mut state = null.clone();
        follow_steps(
            problem,
            &mut state,
            set,
            &VarianceComponents::middle_of_grid(&problem.scales),
            FAR_STEPS,
        );
        selection_rounds(problem, state, &null, set.clone()).filter(|s| !s.chosen.set.is_empty())
    });
    let best =
        followed.map(|s| (mean_cost(problem, &s.state.hypothesis), s)).min_by(|a, b| a.0.total_cmp(&b.0));
    let before = mean_cost(problem, &null.hypothesis);
    Some(best.filter(|b| b.0 < before).map_or(first, |b| b.1))
}

/// Whether, with the effects chosen, the twin's error exceeds the middle of the searched range.
fn is_doubtful(problem: &FrameProblem, selected: &Selected) -> bool {
    selected.chosen.solution.components.surface_m
        > VarianceComponents::middle_of_grid(&problem.scales).surface_m
}

/// Alternates between searching the best set and stepping to its solution.
fn selection_rounds(
    problem: &FrameProblem,
    mut state: State,
    null: &State,
    mut set: Vec<usize>,
) -> Option<Selected> {
    let mut selected = None;
    for round in 0..=ROUNDS {
        let mut linear = problem.linear_system(&state, problem.gate_m());
        if linear.patch_means.is_empty() {
            return None;
        }
        let around = problem.columns_of_set(&linear, &set);
        let reduced = problem.reduce_all(&mut linear, &around);
        let (mut next, rivals) = best_set_and_rivals(problem, &linear, &reduced);
        if round == ROUNDS {
            // The last round judges the effects already in the state.
            next.clone_from(&set);
        }
        let chosen = problem.chosen_of_set(&linear, &reduced, &next)?;
        let stays = next == set;
        set = next;
        let components = chosen.solution.components;
        selected =
            Some(Selected { state: state.clone(), null: null.clone(), linear, reduced, chosen, rivals });
        if stays {
            break;
        }
        let before = mean_cost(problem, &state.hypothesis);
        follow_steps(problem, &mut state, &set, &components, NEAR_STEPS);
        if mean_cost(problem, &state.hypothesis) > SAME_COST * before {
            // After the steps, the effects explain less than the linear system promised.
            return selected.and_then(|s: Selected| {
                let chosen = problem.chosen_of_set(&s.linear, &s.reduced, &[])?;
                Some(Selected { state: null.clone(), chosen, ..s })
            });
        }
    }
    selected
}

/// The selection for another set of effects: stepped to its solution and judged there.
pub fn with_set(problem: &FrameProblem, selected: &Selected, set: &[usize]) -> Option<Selected> {
    let mut state = selected.state.clone();
    follow_steps(problem, &mut state, set, &selected.chosen.solution.components, NEAR_STEPS);
    let mut linear = problem.linear_system(&state, problem.gate_m());
    let around = problem.columns_of_set(&linear, set);
    let reduced = problem.reduce_all(&mut linear, &around);
    let chosen = problem.chosen_of_set(&linear, &reduced, set)?;
    Some(Selected {
        state,
        null: selected.null.clone(),
        linear,
        reduced,
        chosen,
        rivals: selected.rivals.clone(),
    })
}
