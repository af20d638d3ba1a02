//! The loops of Gauss-Newton steps.

use crate::camera::fit::{components::VarianceComponents, linear::State, problem::FrameProblem};

/// Number of steps for the twin without effects, or from a distant start.
pub(super) const FAR_STEPS: usize = 3;
/// Number of steps for the twin with effects, from a near start.
pub(super) const NEAR_STEPS: usize = 2;

/// Moves a state by several steps with a set of trials free.
pub(super) fn follow_steps(
    problem: &FrameProblem,
    state: &mut State,
    set: &[usize],
    components: &VarianceComponents,
    steps: usize,
) {
    for _ in 0..steps {
        problem.step_state(state, set, components, problem.gate_m());
    }
}

/// Fits the twin without effects; the first step uses twice the gate.
pub(super) fn settle_without_effects(problem: &FrameProblem, state: &mut State) {
    let middle = VarianceComponents::middle_of_grid(&problem.scales);
    problem.step_state(state, &[], &middle, 2.0 * problem.gate_m());
    follow_steps(problem, state, &[], &middle, FAR_STEPS - 1);
}
