//! Effects that predict: each must better windows of runs that it was not fitted to.

use rayon::prelude::*;

use crate::gap::{
    fit::{
        noise::EffortNoise,
        problem::Problem,
        shooting::{Free, Pace, fit},
    },
    judge::{
        proof::{residuals, started},
        search::{Candidate, candidate},
    },
    model::joint_model::JointModel,
    record::log::rms,
};
use crate::statistics::median;

/// Lengths of the windows in which effects must show, as shares of those that are fitted.
/// derived: what acts all the time shows best over whole windows, what acts at a place or for a moment in
/// short ones.
const LENGTHS: [f64; 2] = [1.0, 0.25];

/// Standard errors above zero at which a mean is surely above it in one of the lengths.
/// derived: the normal quantile at 97.5 %, 5 % over two tests.
const SURELY: f64 = 1.959_964;

/// Root mean square residuals of windows of each length.
type Sizes = [Vec<f64>; LENGTHS.len()];

/// The set without the effects that do not surely better the windows of runs that they were not fitted to,
/// the one that betters them least first.
#[must_use]
pub fn predictive(problem: &Problem, chosen: &Candidate) -> Candidate {
    let folds = problem.folds();
    let predicted = |model: &JointModel| crossed(&folds, model, chosen.fit.noise);
    let mut model = chosen.fit.model.clone();
    let mut with = predicted(&model);
    loop {
        let without = |i: usize| {
            let mut fewer = model.clone();
            fewer.terms.remove(i);
            let sizes = predicted(&fewer);
            let errors = with.iter().zip(&sizes).map(|(a, b)| errors_better(a, b));
            (errors.fold(f64::NEG_INFINITY, f64::max), fewer, sizes)
        };
        // A push of one run predicts no other run.
        let repeats = |i: &usize| !problem.catalogue[model.terms[*i].effect].is_of_one_run();
        let tried: Vec<_> = (0..model.terms.len()).filter(repeats).map(without).collect();
        match tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((errors, fewer, sizes)) if !(errors > SURELY) => (model, with) = (fewer, sizes),
            _ => break,
        }
    }
    if model.terms.len() == chosen.fit.model.terms.len() {
        return chosen.clone();
    }
    let starts = Some(chosen.fit.starts.as_slice());
    candidate(problem, fit(problem, &model, starts, chosen.fit.noise, Free::All, Pace::thorough(2)))
}

/// Whether a model surely predicts windows of some length better than another, and explains more of the
/// squared residuals of that one than it leaves.
#[must_use]
pub fn predicts_better(problem: &Problem, model: &JointModel, other: &JointModel) -> bool {
    is_better(&sizes(problem, model), &sizes(problem, other), problem.noise_floor())
}

/// Whether windows that a model was not fitted to bear it out against another one: those of held-out runs,
/// and those of each fitted run under the parameters that the others give.
#[must_use]
pub fn bears_out(
    problem: &Problem,
    held_out: &Problem,
    model: &JointModel,
    other: &JointModel,
    noise: EffortNoise,
) -> bool {
    let [with, without] = unseen(problem, held_out, [model, other], noise);
    is_better(&with, &without, problem.noise_floor())
}

/// Whether the file of a joint that has a model is surely better than one that has another: over whole windows
/// that it was not fitted to, in the mean, in the median and in the sum of squares.
#[must_use]
pub fn serves_better(
    problem: &Problem,
    held_out: &Problem,
    model: &JointModel,
    other: &JointModel,
    noise: EffortNoise,
) -> bool {
    let [[with, ..], [without, ..]] = unseen(problem, held_out, [model, other], noise);
    errors_better(&with, &without) > SURELY
        && median(with.clone()) < median(without.clone())
        && rms(&with) < rms(&without)
}

/// Sizes under two models of windows that they were not fitted to: those of held-out runs, and those of each
/// fitted run under the parameters that the others give.
fn unseen(
    problem: &Problem,
    held_out: &Problem,
    models: [&JointModel; 2],
    noise: EffortNoise,
) -> [Sizes; 2] {
    let folds = problem.predicting().folds();
    models.map(|model| {
        let (mut all, held_out) = (crossed(&folds, model, noise), sizes(held_out, model));
        all.iter_mut().zip(held_out).for_each(|(all, more)| all.extend(more));
        all
    })
}

/// Sizes of the windows of each part under a model with parameters that its complement gives.
fn crossed(folds: &[[Problem; 2]], model: &JointModel, noise: EffortNoise) -> Sizes {
    let one = |[fitted, other]: &[Problem; 2]| {
        let known = fit(fitted, model, None, noise, Free::All, Pace::WARM).model;
        sizes(other, &known)
    };
    let parts: Vec<Sizes> = folds.par_iter().map(one).collect();
    std::array::from_fn(|length| parts.iter().flat_map(|p| p[length].iter().copied()).collect())
}

/// Whether the windows of some length are surely smaller, and their squares beyond the noise less than half.
fn is_better(with: &Sizes, without: &Sizes, floor: f64) -> bool {
    let beyond = |sizes: &[f64]| sizes.iter().map(|s| (s * s - floor * floor).max(0.0)).sum::<f64>();
    with.iter()
        .zip(without)
        .any(|(with, without)| errors_better(with, without) > SURELY && beyond(with) < 0.5 * beyond(without))
}

/// Root mean square residuals of windows of each length under a model.
fn sizes(problem: &Problem, model: &JointModel) -> Sizes {
    LENGTHS.map(|share| {
        let problem = problem.with_windows(share);
        let (model, starts) = started(&problem, model);
        residuals(&problem, &model, &starts).iter().map(|(_, r)| rms(r)).collect()
    })
}

/// By how many standard errors the mean of `without` is above that of `with`, pair by pair.
fn errors_better(with: &[f64], without: &[f64]) -> f64 {
    let n = with.len().max(2) as f64;
    let differences = || without.iter().zip(with).map(|(a, b)| a - b);
    let mean = differences().sum::<f64>() / n;
    let variance = differences().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0);
    if variance > 0.0 { mean / (variance / n).sqrt() } else { 0.0 }
}
