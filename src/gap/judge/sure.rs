//! Effects of which a recording in which something else remains leaves open whether they are there at all.

use crate::gap::{
    fit::problem::Problem,
    judge::{refined::refined, search::Candidate, simplify::refitted, spread::Spread},
    model::joint_model::{JointModel, Term},
};

/// The set without those effects that may as well be absent, the likeliest first, down to one, with its
/// refined model, `None` where nothing was found; what was given stays. The search asks what each effect adds to the samples; what remains beside all of
/// them adds to the samples too, so that the intervals have the last word. See docs/method.md 14.11.
#[must_use]
pub fn sure(
    problem: &Problem,
    mut chosen: Candidate,
    is_given: bool,
) -> (Candidate, Option<(JointModel, Spread)>) {
    if chosen.fit.model.terms.is_empty() {
        return (chosen, None);
    }
    loop {
        let (model, spread) = refined(problem, &chosen.fit);
        let doubtful = if is_given || model.terms.len() < 2 || !chosen.fit.noise.remains() {
            None
        } else {
            doubtful(problem, &model, &spread)
        };
        let Some(doubtful) = doubtful else { return (chosen, Some((model, spread))) };
        let mut fewer = chosen.fit.model.clone();
        fewer.terms.remove(doubtful);
        chosen = refitted(problem, &chosen, &fewer);
    }
}

/// The term that is likeliest to be absent, of those whose strengths may all be neutral together. A shape
/// stands for a strength as well (a narrower one is stronger), so that an effect that has one is not asked.
#[must_use]
pub fn doubtful(problem: &Problem, model: &JointModel, spread: &Spread) -> Option<usize> {
    let away = |(i, (at, term)): (usize, (usize, &Term))| {
        let parameters = problem.catalogue[term.effect].parameters();
        let off: Option<Vec<f64>> =
            term.p.iter().zip(parameters).map(|(p, own)| Some(p - own.neutral?)).collect();
        Some((i, spread.away(at, &off?)))
    };
    let least = model.placed().enumerate().filter_map(away).min_by(|a, b| a.1.total_cmp(&b.1));
    least.filter(|(_, away)| *away <= 1.0).map(|(i, _)| i)
}
