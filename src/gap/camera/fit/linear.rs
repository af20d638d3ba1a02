//! Gauss-Newton over a hypothesis: compare, average, linearize, solve, advance.

use nalgebra::DVector;
use rayon::prelude::*;

use crate::camera::{
    fit::{
        components::VarianceComponents,
        mixed::System,
        patches::{PatchMean, patch_means},
        problem::FrameProblem,
        reduced::{Reduced, Solution, best_evidence},
    },
    model::{
        advance::advance_hypothesis, hypothesis::Hypothesis, parameter::HypothesisParameter, posed::PosedTwin,
    },
};

/// A hypothesis and the values of the effects applied to it.
#[derive(Clone, Debug)]
pub struct State {
    /// The hypothesis.
    pub hypothesis: Hypothesis,
    /// Values of the effects' parameters applied to the hypothesis.
    pub applied: Vec<(HypothesisParameter, f64)>,
}

/// The system linearized about a state.
pub struct Linear {
    /// Patches in the order of the matrix rows.
    pub patch_means: Vec<PatchMean>,
    /// The system: nuisance columns first, then the columns of all trials.
    pub system: System,
    /// Column indices of each trial.
    pub of_trial: Vec<Vec<usize>>,
}

/// A set of trials and its solution.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// Indices of the trials.
    pub set: Vec<usize>,
    /// Solution: nuisance values, then the values of the trials' columns in order.
    pub solution: Solution,
}

impl FrameProblem<'_> {
    /// Linearizes the residuals about a state.
    pub fn linear_system(&self, state: &State, gate_m: f64) -> Linear {
        let samples = self.pixel_samples(&state.hypothesis, gate_m);
        let posed = PosedTwin::new(self.twin, self.runs, &state.hypothesis);
        let (means, patches) = patch_means(self.twin, &posed.parts, &samples, |_, f| !self.is_held_out(f));
        let mut columns = self.nuisance.clone();
        // Trials share parameters; each parameter has one column.
        let mut of_trial = Vec::new();
        for t in &self.trials {
            of_trial.push(
                t.columns
                    .iter()
                    .map(|c| {
                        columns.iter().position(|k| k == c).unwrap_or_else(|| {
                            columns.push(*c);
                            columns.len() - 1
                        })
                    })
                    .collect(),
            );
        }
        // The part of the residual explained by the state's effects is added back.
        let with_residual = means
            .into_iter()
            .map(|c| {
                let explained: f64 =
                    state.applied.iter().map(|(p, x)| posed.reading_derivative(*p, &c.seen) * x).sum();
                (c, c.residual_m + explained)
            })
            .collect();
        let (system, patch_means) =
            System::new(with_residual, patches, columns, self.scales.radius_m, |p, c| {
                posed.reading_derivative(p, &c.seen)
            });
        Linear { patch_means, system, of_trial }
    }

    /// Columns of a set of trials, after the nuisance columns.
    pub fn columns_of_set(&self, linear: &Linear, set: &[usize]) -> Vec<usize> {
        (0..self.nuisance.len()).chain(set.iter().flat_map(|&t| linear.of_trial[t].iter().copied())).collect()
    }

    /// One Gauss-Newton step of a state with a set of trials free; all other effects are removed.
    pub fn step_state(&self, state: &mut State, set: &[usize], components: &VarianceComponents, gate_m: f64) {
        let mut linear = self.linear_system(state, gate_m);
        let subset = self.columns_of_set(&linear, set);
        // Outliers are visible only about a solution, and the first solution was biased by them.
        for _ in 0..2 {
            let Some(solution) =
                linear.system.reduced_system(components).and_then(|r| r.solution_of(&subset))
            else {
                return;
            };
            let left = linear.system.residuals_left(&subset, &solution.values);
            linear.system.soften_outliers(&left);
        }
        if let Some(solution) = linear.system.reduced_system(components).and_then(|r| r.solution_of(&subset))
        {
            self.move_state(state, &linear, &subset, &solution.values);
        }
    }

    /// Moves a state to a solution.
    pub fn move_state(&self, state: &mut State, linear: &Linear, subset: &[usize], values: &DVector<f64>) {
        let n = self.nuisance.len();
        let mut steps = Vec::new();
        for (&c, &x) in subset.iter().zip(values.iter()).take(n) {
            let parameter = linear.system.columns[c].parameter;
            // Errors of the twin and of reported positions explain residuals but do not change the twin or
            // the reports.
            let stays = match parameter {
                HypothesisParameter::Mesh(..)
                | HypothesisParameter::AxisTurn(..)
                | HypothesisParameter::AxisShift(..) => true,
                HypothesisParameter::Position(r, j) => {
                    self.runs[r].positions.contains_key(&self.twin.joints[j].name)
                }
                _ => false,
            };
            if !stays {
                steps.push((parameter, x));
            }
        }
        let mut target: Vec<(HypothesisParameter, f64)> = Vec::new();
        for (&c, &x) in subset.iter().zip(values.iter()).skip(n) {
            target.push((linear.system.columns[c].parameter, x));
        }
        // Solved values are relative to the twin as given, steps to the present state.
        for (p, x) in &target {
            let applied = state.applied.iter().find(|a| a.0 == *p).map_or(0.0, |a| a.1);
            steps.push((*p, x - applied));
        }
        // Effects no longer chosen are set back to zero.
        for (p, x) in state.applied.iter().filter(|a| !target.iter().any(|t| t.0 == a.0)) {
            steps.push((*p, -x));
        }
        advance_hypothesis(&mut state.hypothesis, self.twin, &steps);
        state.applied = target;
    }

    /// The reduced systems for all grid values of the unnamed errors.
    pub fn reduce_all(&self, linear: &mut Linear, around: &[usize]) -> Vec<Reduced> {
        // Outliers are taken about the set known so far; otherwise the motion of an effect would count as
        // outliers.
        if around.len() > self.nuisance.len()
            && let Some(solution) = linear
                .system
                .reduced_system(&VarianceComponents::middle_of_grid(&self.scales))
                .and_then(|r| r.solution_of(around))
        {
            let left = linear.system.residuals_left(around, &solution.values);
            linear.system.soften_outliers(&left);
        }
        VarianceComponents::search_grid(&self.scales)
            .par_iter()
            .filter_map(|s| linear.system.reduced_system(s))
            .collect()
    }

    /// Solution of a set with the most probable variance components.
    pub fn chosen_of_set(&self, linear: &Linear, reduced: &[Reduced], set: &[usize]) -> Option<Chosen> {
        let subset = self.columns_of_set(linear, set);
        let (_, i) = best_evidence(reduced, &subset);
        Some(Chosen { set: set.to_vec(), solution: reduced.get(i)?.solution_of(&subset)? })
    }

    /// Evidence of a set, without its solution.
    pub fn evidence_of_set(&self, linear: &Linear, reduced: &[Reduced], set: &[usize]) -> f64 {
        best_evidence(reduced, &self.columns_of_set(linear, set)).0 + self.log_odds(set)
    }

    fn log_odds(&self, set: &[usize]) -> f64 {
        set.iter().map(|&t| self.trials[t].log_odds).sum()
    }
}
