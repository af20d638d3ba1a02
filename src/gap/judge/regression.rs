//! Regression of several effects together on the residuals of a fitted model, along the measured motion. Fits
//! started from it reach the right basin even if effects found one by one would imitate each other.

use crate::{
    fit::problem::Problem,
    judge::{
        columns::Columns,
        screen::{Hit, Screen, amplitude_count},
    },
    model::{
        effect::{At, Place},
        joint_model::{JointModel, Term},
    },
};

/// Number of shapes tried for each effect in a regression.
/// derived: the best one alone, and the next one if another effect takes its place.
const SHAPES: usize = 2;

/// Amplitudes of effects with given shapes, regressed together, and the gain of twice the log likelihood to
/// first order. `None` if the columns cannot be separated.
#[must_use]
pub fn regressed_terms(
    problem: &Problem,
    screen: &Screen,
    states: &[Vec<At>],
    terms: &[Term],
) -> Option<(f64, Vec<Term>)> {
    let counts: Vec<usize> =
        terms.iter().map(|t| amplitude_count(problem.catalogue[t.effect].as_ref())).collect();
    let mut parts: Vec<_> = terms
        .iter()
        .zip(&counts)
        .map(|(t, count)| {
            (screen.column_filler(problem.catalogue[t.effect].as_ref(), &t.p, states), Columns::new(*count))
        })
        .collect();
    let score = screen.score_columns(counts.iter().sum(), |window, span, columns| {
        let mut at = 0;
        for (fill, own) in &mut parts {
            own.clear(span.len);
            fill(window, span, own);
            for (effort, active) in own.effort.iter().zip(&own.active) {
                columns.effort[at].copy_from_slice(effort);
                columns.active[at] = *active;
                at += 1;
            }
        }
    })?;
    let mut at = 0;
    let mut found = terms.to_vec();
    for (term, count) in found.iter_mut().zip(&counts) {
        let effect = &problem.catalogue[term.effect];
        for i in 0..*count {
            let neutral = effect.parameters()[i].neutral.unwrap_or(0.0);
            let (low, high) = effect.parameter_bounds(i, &problem.coverage);
            term.p[i] = (neutral + score.amplitude[at + i]).clamp(low, high);
        }
        at += count;
    }
    Some((score.gain, found))
}

/// Whether an effect acts as an effort along a measured motion, linear in its amplitudes.
fn is_effort(problem: &Problem, effect: usize) -> bool {
    !matches!(
        problem.catalogue[effect].place(),
        Place::Delay | Place::Play | Place::Contact | Place::Bias | Place::Scale
    )
}

/// A model with its efforts regressed together; its other effects are unchanged.
#[must_use]
pub fn regressed_model(problem: &Problem, screen: &Screen, model: &JointModel) -> Option<JointModel> {
    let (efforts, others): (Vec<Term>, Vec<Term>) =
        model.terms.iter().cloned().partition(|t| is_effort(problem, t.effect));
    let (_, mut terms) = regressed_terms(problem, screen, &screen.all_states(), &efforts)?;
    terms.extend(others);
    Some(JointModel { terms, ..model.clone() })
}

/// Models of one effect, two, and so on. Each adds the effect with the largest gain in a regression of all,
/// minus the price of the parameters, as long as this increases.
#[must_use]
pub fn regressed_sets(
    problem: &Problem,
    screen: &Screen,
    effects: &[usize],
    largest: usize,
) -> Vec<JointModel> {
    let states = screen.all_states();
    let price = problem.independent_count().ln();
    let hits: Vec<Hit> = effects
        .iter()
        .filter(|e| is_effort(problem, **e))
        .flat_map(|e| screen.best_hits(*e, SHAPES))
        .collect();
    let mut sets: Vec<JointModel> = Vec::new();
    let mut terms = Vec::<Term>::new();
    let mut reached = 0.0;
    while terms.len() < largest {
        let mut trials = Vec::new();
        for hit in &hits {
            let spec = problem.catalogue[hit.effect].effect_spec();
            if terms.iter().any(|t| problem.catalogue[t.effect].effect_spec().overlaps_with(spec)) {
                continue;
            }
            let mut more = terms.clone();
            more.push(Term { effect: hit.effect, p: hit.p.clone() });
            let Some((gain, found)) = regressed_terms(problem, screen, &states, &more) else { continue };
            let parameters: usize = found.iter().map(|t| t.p.len()).sum();
            trials.push((gain - price * parameters as f64, found));
        }
        let best = trials.into_iter().max_by(|a, b| a.0.total_cmp(&b.0));
        let Some((gain, found)) = best.filter(|(gain, _)| *gain > reached) else { break };
        (reached, terms) = (gain, found);
        sets.push(JointModel { terms: terms.clone(), ..JointModel::of_plant(&problem.plant) });
    }
    sets
}
