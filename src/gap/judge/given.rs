//! Fits of given effects, from starts found one by one and from a regression of all.

use crate::{
    fit::problem::Problem,
    judge::{
        name_weight::least_gain,
        regression::regressed_model,
        screen::Screen,
        search::{Candidate, Search, best_of_each_set, fitted_from_seed, fitted_twin, grown_sets},
    },
};

/// Fits a given set of effects.
#[must_use]
pub fn given_set(problem: &Problem, effects: &[usize]) -> (Search, Candidate) {
    let base = fitted_twin(problem);
    let mut by_size = vec![vec![base.clone()]];
    let mut chosen = base.clone();
    for effect in effects {
        let hits = Screen::new(problem, &chosen.fit).best_hits(*effect, 2);
        let grown = best_of_each_set(grown_sets(problem, &chosen, &[hits]));
        // Alone, an effect may be invisible until the others are fitted.
        let Some(next) = grown.into_iter().next() else { continue };
        chosen = next;
        by_size.push(Vec::new());
    }
    // Fitted one by one, the first effect may imitate later ones.
    let together = regressed_model(problem, &Screen::new(problem, &base.fit), &chosen.fit.model);
    if let Some(other) =
        together.map(|m| fitted_from_seed(problem, &base, &m)).filter(|o| o.score > chosen.score)
    {
        chosen = other;
    }
    (Search { by_size, disturbance: None, least_gain: least_gain(problem.catalogue.len()) }, chosen)
}
