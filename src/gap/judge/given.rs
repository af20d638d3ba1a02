//! Effects with given names, fitted from their places found one by one and from those of a regression.

use crate::{
    fit::problem::Problem,
    judge::{
        name_weight::least_gain,
        regression::regressed_model,
        screen::Screen,
        search::{Candidate, Search, baseline, begun, best_of_each_set, grow},
    },
};

/// A given set of effects.
#[must_use]
pub fn given(problem: &Problem, effects: &[usize]) -> (Search, Candidate) {
    let base = baseline(problem);
    let mut by_size = vec![vec![base.clone()]];
    let mut chosen = base.clone();
    for effect in effects {
        let hits = Screen::new(problem, &chosen.fit).hits(*effect, 2);
        let grown = best_of_each_set(grow(problem, &chosen, &[hits]));
        // Alone, an effect may show nothing without the others to come.
        let Some(next) = grown.into_iter().next() else { continue };
        chosen = next;
        by_size.push(Vec::new());
    }
    // One by one, the first may take the place of later ones.
    let together = regressed_model(problem, &Screen::new(problem, &base.fit), &chosen.fit.model);
    if let Some(other) = together.map(|m| begun(problem, &base, &m)).filter(|o| o.score > chosen.score) {
        chosen = other;
    }
    (Search { by_size, disturbance: None, least_gain: least_gain(problem.catalogue.len()) }, chosen)
}
