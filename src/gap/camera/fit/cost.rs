//! Mean cost of pixels, conflicts included: comparable between hypotheses of any kind.

use crate::camera::{
    fit::{components::VarianceComponents, problem::FrameProblem, sample::Sample},
    model::hypothesis::Hypothesis,
};

/// Cost of a conflicting pixel.
///
/// derived: half the square of three standard deviations
const CONFLICT_COST: f64 = 4.5;
/// Costs within this ratio count as equal.
///
/// tuned: made objects (tests/gap_frames.rs)
pub const SAME_COST: f64 = 1.05;

/// Mean cost of all pixels; a conflict has a fixed cost, so hypotheses of different joint types are
/// comparable.
pub fn mean_cost(problem: &FrameProblem, hypothesis: &Hypothesis) -> f64 {
    mean_costs_by_part(problem, hypothesis).last().copied().unwrap_or(f64::INFINITY)
}

/// Mean cost of the pixels of each part, followed by the mean over all pixels.
pub fn mean_costs_by_part(problem: &FrameProblem, hypothesis: &Hypothesis) -> Vec<f64> {
    let samples = problem.pixel_samples(hypothesis, problem.gate_m());
    let unnamed_m = VarianceComponents::middle_of_grid(&problem.scales).total_m();
    let n = problem.twin.parts.len();
    let mut sums = vec![(0.0, 0usize); n + 1];
    for s in &samples {
        let (part, cost) = match &s.sample {
            Sample::Match { seen, residual_m, sigma_m, .. } => {
                // docs/method.md (15.9): a match never costs more than a conflict, so no pose gains by
                // turning matches into conflicts.
                let variance = sigma_m * sigma_m + unnamed_m * unnamed_m;
                (Some(seen.part), (0.5 * residual_m * residual_m / variance).min(CONFLICT_COST))
            }
            Sample::Conflict { part, .. } => (*part, CONFLICT_COST),
        };
        for k in part.into_iter().chain([n]) {
            sums[k] = (sums[k].0 + cost, sums[k].1 + 1);
        }
    }
    sums.iter().map(|(sum, count)| sum / (*count).max(1) as f64).collect()
}
