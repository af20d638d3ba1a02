//! Simplifies a found set of effects as far as the recording allows: special cases replace general effects,
//! and effects with zero in the interval of every strength are removed.

use crate::{
    fit::{
        problem::Problem,
        shooting::{Fit, Free, Pace, shooting_fit},
    },
    judge::search::{Candidate, scored_candidate},
    model::joint_model::{JointModel, Term},
};
use numeric::statistics::HALF_WIDTH_95;

/// Allowed loss of score of a simpler set: with a special case instead of the general effect, or with one
/// effect less.
/// chosen: very strong evidence in twice the log of a Bayes factor (Kass and Raftery 1995).
pub const SIMPLER: f64 = 10.0;

/// Replaces effects by special cases that do about as well, and removes unsure effects.
#[must_use]
pub fn simplified_set(problem: &Problem, found: &Candidate) -> Candidate {
    let mut chosen = found.clone();
    while let Some(simpler) = special_cases(problem, &chosen) {
        chosen = simpler;
    }
    let mut kept = 0;
    while let Some(doubtful) =
        doubtful_term(problem, &chosen, kept).filter(|_| chosen.fit.model.terms.len() > 1)
    {
        let mut model = chosen.fit.model.clone();
        model.terms.remove(doubtful);
        let without = refitted_set(problem, &chosen, &model);
        if without.score < chosen.score - SIMPLER {
            // One short contact does not separate its strengths: each is unsure, but together they are
            // needed.
            kept = doubtful + 1;
        } else {
            chosen = without;
        }
    }
    chosen
}

/// Fits a model to the end, from the start states and the noise of a candidate.
#[must_use]
pub fn refitted_set(problem: &Problem, from: &Candidate, model: &JointModel) -> Candidate {
    scored_candidate(
        problem,
        shooting_fit(problem, model, Some(&from.fit.starts), from.fit.noise, Free::All, Pace::thorough(2)),
    )
}

/// The special cases of an effect, with the parameters they share with it.
#[must_use]
pub fn special_terms(problem: &Problem, term: &Term) -> Vec<Term> {
    let general = &problem.catalogue[term.effect];
    general.effect_spec().contains.iter().filter_map(|name| special_term(problem, term, name)).collect()
}

/// The special case with a given name; `None` if the catalogue or the motion does not have it.
fn special_term(problem: &Problem, term: &Term, name: &str) -> Option<Term> {
    let effect = problem.catalogue.iter().position(|e| e.name() == name)?;
    let mut p = problem.catalogue[effect].start_shapes(&problem.coverage).into_iter().next()?;
    let own = problem.catalogue[effect].parameters();
    for (k, (own, other)) in own.iter().zip(problem.catalogue[term.effect].parameters()).enumerate() {
        // Shared parameters come first in both lists, so equal index and dimension mean the same parameter.
        if own.dimension == other.dimension {
            p[k] = term.p[k];
        }
    }
    Some(Term { effect, p })
}

/// Replaces term `i` of a model by another effect and refits it from the start states of a fit.
#[must_use]
pub fn fit_with_replacement(problem: &Problem, model: &JointModel, i: usize, other: Term, from: &Fit) -> Fit {
    let mut model = model.clone();
    model.terms[i] = other;
    shooting_fit(problem, &model, Some(&from.starts), from.noise, Free::All, Pace::NEXT)
}

/// The best set with one effect replaced by a special case, provided this does about as well or loses only
/// strengths possibly zero. Shared parameters come first in both.
fn special_cases(problem: &Problem, chosen: &Candidate) -> Option<Candidate> {
    let mut simpler = Vec::new();
    for (i, (at, term)) in chosen.fit.model.placed_terms().enumerate() {
        let general = &problem.catalogue[term.effect];
        for special in special_terms(problem, term) {
            let own = problem.catalogue[special.effect].parameters();
            let lost_is_sure = (0..term.p.len()).any(|k| {
                let is_shared = own.get(k).is_some_and(|o| o.name == general.parameters()[k].name);
                !is_shared && is_sure(problem, chosen, i, at, k)
            });
            let begun = scored_candidate(
                problem,
                fit_with_replacement(problem, &chosen.fit.model, i, special, &chosen.fit),
            );
            let fitted = refitted_set(problem, &begun, &begun.fit.model);
            if fitted.score > chosen.score - SIMPLER || (!lost_is_sure && fitted.score.is_finite()) {
                simpler.push(fitted);
            }
        }
    }
    simpler.into_iter().max_by(|a, b| a.score.total_cmp(&b.score))
}

/// Whether parameter `k` of term `i`, with columns from `at` on, is a strength surely off its neutral value.
fn is_sure(problem: &Problem, chosen: &Candidate, i: usize, at: usize, k: usize) -> bool {
    let term = &chosen.fit.model.terms[i];
    let deviation = chosen.fit.parameter_deviation(at + k);
    let neutral = problem.catalogue[term.effect].parameters()[k].neutral;
    neutral.is_some_and(|neutral| (term.p[k] - neutral).abs() > HALF_WIDTH_95 * deviation)
}

/// Index of the first effect, from `first` on, without any strength surely off its neutral value.
fn doubtful_term(problem: &Problem, chosen: &Candidate, first: usize) -> Option<usize> {
    let terms = chosen.fit.model.placed_terms().enumerate().skip(first);
    for (i, (at, term)) in terms {
        if !(0..term.p.len()).any(|k| is_sure(problem, chosen, i, at, k)) {
            return Some(i);
        }
    }
    None
}
