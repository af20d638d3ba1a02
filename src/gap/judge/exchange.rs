//! Sets that differ from a found one by a single effect: growing one by one misses those whose first member was
//! not the best.

use rayon::prelude::*;

use crate::gap::{
    fit::{problem::Problem, shooting::MAX_FIT_FREE},
    judge::search::{Candidate, FINALISTS, begun, best_of_each_set},
    model::joint_model::JointModel,
};

/// Sets with, beside them, the best of them with each of its effects in exchange for each of those that lead
/// alone, `singles`. Fits begin at the parameters of both, and at the start states of `base`.
#[must_use]
pub fn with_exchanges(
    problem: &Problem,
    base: &Candidate,
    sets: Vec<Candidate>,
    singles: &[Candidate],
) -> Vec<Candidate> {
    let Some(best) = sets.first() else { return sets };
    let spec = |effect: usize| problem.catalogue[effect].spec();
    let mut seeds: Vec<JointModel> = Vec::new();
    for i in 0..best.fit.model.terms.len() {
        for single in singles.iter().take(FINALISTS) {
            let Some(new) = single.fit.model.terms.first() else { continue };
            let mut model = best.fit.model.clone();
            model.terms.remove(i);
            if model.terms.iter().any(|t| spec(t.effect).overlaps(spec(new.effect))) {
                continue;
            }
            model.terms.push(new.clone());
            let effects = model.effects();
            let is_fitted = model.free() <= MAX_FIT_FREE;
            if is_fitted
                && !sets.iter().any(|s| s.effects() == effects)
                && !seeds.iter().any(|s| s.effects() == effects)
            {
                seeds.push(model);
            }
        }
    }
    let fitted: Vec<Candidate> = seeds.par_iter().map(|s| begun(problem, base, s)).collect();
    best_of_each_set(sets.into_iter().chain(fitted).collect())
}
