//! Searches the best set of effects for the logs: single effects, then pairs and triples grown from several
//! of them.

use rayon::prelude::*;
use tracing::debug;

use crate::{
    fit::{
        noise::EffortNoise,
        problem::{Problem, Weighing},
        shooting::{Fit, Free, MAX_FIT_FREE, Pace, shooting_fit},
    },
    judge::{
        breadth::Breadth,
        exchange::exchanged_sets,
        regression::regressed_sets,
        screen::{Hit, Screen},
    },
    model::{
        effect::{At, Place, Spec, run_time_s},
        joint_model::{JointModel, SETTLE_S, Term},
    },
    record::off_axis::MAX_LEFT,
};

/// A fitted set of effects.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// The fit.
    pub fit: Fit,
    /// Twice the log likelihood minus the price of its parameters and shapes.
    pub score: f64,
}

impl Candidate {
    /// Indices of its effects, sorted.
    #[must_use]
    pub fn effects(&self) -> Vec<usize> {
        self.fit.model.effect_indices()
    }
}

/// What a search may find.
#[derive(Clone, Copy, Debug)]
pub struct Scope<'a> {
    /// Catalogue indices of the effects tried.
    pub effects: &'a [usize],
    /// Additional sets to be tried; their fits start from these parameters.
    pub seeds: &'a [JointModel],
    /// Least gain of score for one more effect.
    pub least_gain: f64,
}

/// Fitted sets by size: index 0 holds the twin itself, then singles, pairs, ...; each list best first.
#[derive(Debug)]
pub struct Search {
    /// Candidates, by number of effects.
    pub by_size: Vec<Vec<Candidate>>,
    /// Catalogue index of the disturbance.
    pub disturbance: Option<usize>,
    /// Least gain of score for one more effect.
    pub least_gain: f64,
}

impl Search {
    /// The largest set whose score exceeds that of the accepted smaller one by the wanted gain.
    #[must_use]
    pub fn accepted_set(&self) -> &Candidate {
        let nothing = self.by_size[0][0].score;
        let mut best = &self.by_size[0][0];
        for sets in self.by_size.iter().skip(1) {
            let gained = best.score - nothing;
            // Sets after the finalists were not fitted to the end.
            let mut finalists = sets.iter().take(FINALISTS);
            if let Some(first) = finalists.find(|c| c.score > best.score + self.wanted_gain(c, gained)) {
                best = first;
            }
        }
        best
    }

    /// Gain of score needed to accept a set, if the smaller one already gained `gained`.
    fn wanted_gain(&self, set: &Candidate, gained: f64) -> f64 {
        let has_push = self.disturbance.is_some_and(|d| set.effects().contains(&d));
        // A badly predicted window resembles a push, so a push must gain more than a fit may leave.
        let share = if set.fit.model.terms.len() > 1 && has_push { MAX_LEFT } else { MIN_SHARE };
        self.least_gain.max(gained * share)
    }
}

/// Price of a set of effects, for each parameter and each choice of a shape. See docs/method.md (14.15).
#[must_use]
pub fn price_of_model(problem: &Problem, model: &JointModel) -> f64 {
    model.terms.iter().map(|t| term_price(problem, t)).sum()
}

fn term_price(problem: &Problem, term: &Term) -> f64 {
    let shapes = problem.catalogue[term.effect].start_shapes(&problem.coverage).len().max(1) as f64;
    term.p.len() as f64 * problem.independent_count().ln() + 2.0 * shapes.ln()
}

/// A fit with its score.
#[must_use]
pub fn scored_candidate(problem: &Problem, fit: Fit) -> Candidate {
    let score = 2.0 * fit.log_likelihood - price_of_model(problem, &fit.model);
    // A single effect may be weak: there is no other whose shape it could be correcting.
    let whole = fit.model.terms.len() < 2
        || (fit.model.terms.iter().all(|t| is_felt(problem, t)) && !mends_fall(problem, &fit.model));
    Candidate { score: if score.is_finite() && whole { score } else { f64::NEG_INFINITY }, fit }
}

/// Least peak effort of an effect in a larger set, as a share of the recorded efforts' root mean square. A
/// smaller one only corrects the shape of the others.
/// tuned: tests/python/gap/generate.py.
const MIN_FELT: f64 = 0.02;

/// Whether velocity-dependent efforts only correct the shape of a friction falling with speed: they are
/// smaller than an explanation of this fall may leave open, as its exact law is unknown.
fn mends_fall(problem: &Problem, model: &JointModel) -> bool {
    let of = |t: &Term| &problem.catalogue[t.effect];
    let fall = model.terms.iter().map(|t| of(t).friction_fall(&t.p)).fold(0.0, f64::max);
    let mut by_velocity = model.terms.iter().filter(|t| of(t).is_of_velocity()).peekable();
    if fall <= 0.0 || by_velocity.peek().is_none() {
        return false;
    }
    let menders: Vec<&Term> = by_velocity.collect();
    (1..=10).all(|i| {
        // derived: tenths of the top speed.
        let v = 0.1 * f64::from(i) * problem.coverage.speed.1;
        let at = At { v, direction: 1.0, ..At::default() };
        let effort: f64 = menders.iter().map(|t| t.value_at(problem.catalogue, &at)).sum();
        effort.abs() < MAX_LEFT * fall
    })
}

/// Whether an effort or a friction is strong enough for a set with other effects.
fn is_felt(problem: &Problem, term: &Term) -> bool {
    let effect = &problem.catalogue[term.effect];
    if !matches!(effect.place(), Place::Effort | Place::Contact | Place::Friction) {
        return true;
    }
    let least = MIN_FELT * problem.coverage.effort_rms;
    for (index, trace) in problem.traces.iter().enumerate() {
        let log = &problem.logs[index];
        let mut others = [0.0; 8];
        for k in (0..trace.position.len()).step_by(3) {
            for (x, other) in others.iter_mut().zip(&log.others) {
                *x = other[k];
            }
            let at = At {
                q: trace.position[k],
                v: trace.velocity[k],
                u: trace.effort[k],
                feedback: [0.0; 2],
                t: run_time_s(index, log, k),
                direction: if trace.velocity[k] < 0.0 { -1.0 } else { 1.0 },
                others: &others,
                load: 0.0,
                carried: log.carried.get(k),
            };
            if term.value_at(problem.catalogue, &at).abs() >= least {
                return true;
            }
        }
    }
    false
}

/// Effort noise at the start of a fit, as a share of the recorded effort.
/// chosen: a start value, replaced by the fit.
const FIRST_NOISE: f64 = 0.02;

/// The twin as given, with its start states and noise fitted.
#[must_use]
pub fn fitted_twin(problem: &Problem) -> Candidate {
    let guess =
        EffortNoise::white_noise(FIRST_NOISE * problem.coverage.effort_rms.max(problem.min_sigma_u * 10.0));
    scored_candidate(
        problem,
        shooting_fit(
            problem,
            &JointModel::of_plant(&problem.plant),
            None,
            guess,
            Free::All,
            Pace::thorough(3),
        ),
    )
}

/// Searches sets of effects up to `breadth.largest`; stops growing if one more effect gains too little.
#[must_use]
pub fn searched_sets(problem: &Problem, breadth: &Breadth, scope: &Scope) -> Search {
    let disturbance = scope.effects.iter().copied().find(|e| problem.catalogue[*e].is_of_one_run());
    let least_gain = scope.least_gain;
    let base = fitted_twin(problem);
    let nothing = base.score;
    let mut by_size = vec![vec![base]];
    let mut seeds = Vec::new();
    if problem.weighing != Weighing::Innovations {
        let screen = Screen::new(problem, &by_size[0][0].fit);
        seeds = regressed_sets(problem, &screen, scope.effects, breadth.regressed);
    }
    seeds.extend_from_slice(scope.seeds);
    let largest_seed = seeds.iter().map(|s| s.terms.len()).max().unwrap_or(0);
    for size in 1..=breadth.largest.max(largest_seed) {
        let (grown, tried) = match size {
            1 => (1, breadth.singles),
            2 => (breadth.grown, breadth.partners),
            // Only the best pair grows: a third effect adds little to it.
            _ => (1, breadth.partners - 1),
        };
        let best_before = best_score(&by_size);
        // One more effect must add a share of the others' gain: an inexact shape is not a further effect.
        let wanted = least_gain.max(MIN_SHARE * (best_before - nothing));
        let mut found: Vec<Candidate> = Vec::new();
        for (rank, parent) in distinct_parents(problem, &by_size[size - 1], grown).into_iter().enumerate() {
            let hits = ranked_hits(problem, parent, scope.effects, tried, if size == 1 { 2 } else { 1 });
            let hope = hits.first().map_or(f64::NEG_INFINITY, |h| h[0].gain);
            // Even to first order no effect promises enough with the best set.
            if rank == 0 && hope < least_gain {
                break;
            }
            found.extend(grown_sets(problem, parent, &hits));
        }
        let of_size: Vec<&JointModel> = seeds.iter().filter(|s| s.terms.len() == size).collect();
        found.extend(
            of_size.par_iter().map(|s| fitted_from_seed(problem, &by_size[0][0], s)).collect::<Vec<_>>(),
        );
        if found.is_empty() && size >= largest_seed {
            break;
        }
        let mut sets = best_of_each_set(found);
        if size > 1 && problem.weighing != Weighing::Innovations {
            sets = with_exchanges(problem, &by_size[0][0], sets, &by_size[1]);
        }
        let best = sets.first().map_or(f64::NEG_INFINITY, |c| c.score);
        for set in sets.iter().take(FINALISTS) {
            let gain = set.score - best_before;
            let model = &set.fit.model;
            let effects = model.effect_names(problem.catalogue);
            debug!(size, ?effects, score = set.score, gain, wanted, "effect added");
        }
        // Growing one by one misses sets whose members are visible only together.
        let smaller: Vec<Candidate> = if size > 1 {
            sets.iter().take(2).flat_map(|c| without_one(problem, c, &by_size[size - 1])).collect()
        } else {
            Vec::new()
        };
        by_size.push(sets);
        if !smaller.is_empty() {
            let known = std::mem::take(&mut by_size[size - 1]);
            by_size[size - 1] = best_of_each_set(known.into_iter().chain(smaller).collect());
        }
        if best < best_score(&by_size[..size]) + wanted && size >= largest_seed {
            break;
        }
    }
    Search { by_size, disturbance, least_gain }
}

/// Highest score of all sets.
fn best_score(by_size: &[Vec<Candidate>]) -> f64 {
    by_size.iter().filter_map(|s| s.first()).map(|c| c.score).fold(f64::NEG_INFINITY, f64::max)
}

/// Fits a set to the end, starting from given parameters.
#[must_use]
pub fn fitted_from_seed(problem: &Problem, base: &Candidate, seed: &JointModel) -> Candidate {
    fitted_to_end(problem, seed, &base.fit, Pace { searches: true, ..Pace::NEXT })
}

/// Adds sets made from the best one by exchanging each of its effects for each of the leading single ones.
/// Fits start from the start states of `base`.
fn with_exchanges(
    problem: &Problem,
    base: &Candidate,
    sets: Vec<Candidate>,
    singles: &[Candidate],
) -> Vec<Candidate> {
    let Some(best) = sets.first() else { return sets };
    let others: Vec<&JointModel> = singles.iter().take(FINALISTS).map(|c| &c.fit.model).collect();
    let seeds = exchanged_sets(problem.catalogue, &best.fit.model, &others, |effects| {
        sets.iter().any(|s| s.effects() == effects)
    });
    let fitted: Vec<Candidate> = seeds.par_iter().map(|s| fitted_from_seed(problem, base, s)).collect();
    best_of_each_set(sets.into_iter().chain(fitted).collect())
}

/// The best candidates; if two differ only by an effect and its special case, the better one.
fn distinct_parents<'c>(problem: &Problem, candidates: &'c [Candidate], count: usize) -> Vec<&'c Candidate> {
    let mut chosen: Vec<&Candidate> = Vec::new();
    for c in candidates {
        if chosen.len() < count && !chosen.iter().any(|o| is_related(problem, o, c)) {
            chosen.push(c);
        }
    }
    chosen
}

/// Whether two sets differ only by one effect and its special case.
fn is_related(problem: &Problem, a: &Candidate, b: &Candidate) -> bool {
    let [a, b] = [a, b].map(|c| specs_of_set(problem, c));
    match (without_names_of(&a, &b).as_slice(), without_names_of(&b, &a).as_slice()) {
        ([x], [y]) => x.overlaps_with(y),
        _ => false,
    }
}

fn specs_of_set(problem: &Problem, set: &Candidate) -> Vec<&'static Spec> {
    set.effects().into_iter().map(|e| problem.catalogue[e].effect_spec()).collect()
}

/// The effects whose names are not among the others.
fn without_names_of<'s>(effects: &[&'s Spec], others: &[&Spec]) -> Vec<&'s Spec> {
    effects.iter().copied().filter(|s| !others.iter().any(|o| o.name == s.name)).collect()
}

/// Refits of the candidate with each of its effects removed in turn, without the known sets.
fn without_one(problem: &Problem, candidate_: &Candidate, known: &[Candidate]) -> Vec<Candidate> {
    let mut models = Vec::new();
    for i in 0..candidate_.fit.model.terms.len() {
        let mut model = candidate_.fit.model.clone();
        model.terms.remove(i);
        if !known.iter().any(|k| k.effects() == model.effect_indices()) {
            models.push(model);
        }
    }
    models.par_iter().map(|model| fitted_to_end(problem, model, &candidate_.fit, Pace::NEXT)).collect()
}

/// Fits a model from the start states and the noise of another fit, first at a pace, then to the end.
fn fitted_to_end(problem: &Problem, model: &JointModel, from: &Fit, pace: Pace) -> Candidate {
    let begun = shooting_fit(problem, model, Some(&from.starts), from.noise, Free::All, pace);
    let starts = Some(begun.starts.as_slice());
    scored_candidate(
        problem,
        shooting_fit(problem, &begun.model, starts, begun.noise, Free::All, Pace::thorough(3)),
    )
}

/// Least gain for one more effect, as a share of the gain so far.
/// tuned: tests/python/gap/generate.py.
const MIN_SHARE: f64 = 0.04;
/// Number of candidates fitted to the end after a first pass over all.
const FINALISTS: usize = 5;

/// Most successive fits of a candidate with play.
const PLAY_FITS: usize = 3;
/// Least gain of one of them for the next to follow.
/// chosen: with a gain of one in the log likelihood, a parameter moves by 1.4 of its standard deviations.
const MIN_GAIN_OF_PLAY_FIT: f64 = 2.0;

/// Fits a parent with each of the hits added; the leading ones after a first round are fitted to the end.
#[must_use]
pub fn grown_sets(problem: &Problem, parent: &Candidate, hits: &[Vec<Hit>]) -> Vec<Candidate> {
    let jobs: Vec<JointModel> = hits.iter().flatten().flat_map(|h| starts_of(problem, parent, h)).collect();
    let begun = leading_starts(jobs.par_iter().map(|m| first_fit(problem, parent, m)).collect());
    let mut fits: Vec<Candidate> =
        best_of_each_set(begun.par_iter().map(|c| fitted_on(problem, c, Pace::NEXT)).collect());
    let leading = &fits[..fits.len().min(FINALISTS)];
    let ended: Vec<Candidate> = leading.par_iter().map(|c| finalist_fit(problem, parent, c)).collect();
    fits.splice(..ended.len(), ended);
    fits
}

/// A short fit with the parent's measured start states, converted to the sensor of the new model.
fn first_fit(problem: &Problem, parent: &Candidate, model: &JointModel) -> Candidate {
    let seen = parent.fit.model.position_sensor(problem.catalogue);
    let sees = model.position_sensor(problem.catalogue);
    let mut starts = parent.fit.starts.clone();
    for s in &mut starts {
        let measured = seen.scale * (s.position + s.play * seen.half_gap) + seen.bias;
        s.position = (measured - sees.bias) / sees.scale - s.play * sees.half_gap;
        s.velocity = s.velocity * seen.scale / sees.scale;
    }
    scored_candidate(
        problem,
        shooting_fit(problem, model, Some(&starts), parent.fit.noise, Free::All, Pace::FIRST),
    )
}

/// Continues the fit of a candidate, if this raises its score.
fn fitted_on(problem: &Problem, c: &Candidate, pace: Pace) -> Candidate {
    let again = shooting_fit(problem, &c.fit.model, Some(&c.fit.starts), c.fit.noise, Free::All, pace);
    let again = scored_candidate(problem, again);
    if again.score > c.score { again } else { c.clone() }
}

/// A candidate fitted to the end, unless its parent is better. One with play is fitted several times: play is
/// found window by window, and with the smaller noise of a better fit more windows find their side of the
/// gap.
fn finalist_fit(problem: &Problem, parent: &Candidate, c: &Candidate) -> Candidate {
    let has_play = c.fit.model.position_sensor(problem.catalogue).half_gap > 0.0;
    let is_alone = has_play && parent.fit.model.terms.is_empty();
    if !(c.score >= parent.score) && !is_alone {
        return c.clone();
    }
    let mut now = fitted_on(problem, c, Pace::thorough(2));
    for _ in 1..PLAY_FITS {
        let has_play = now.fit.model.position_sensor(problem.catalogue).half_gap > 0.0;
        if !has_play || !(now.score >= parent.score) {
            return now;
        }
        let next = fitted_on(problem, &now, Pace::thorough(2));
        if next.score < now.score + MIN_GAIN_OF_PLAY_FIT {
            return next;
        }
        now = next;
    }
    now
}

/// Number of starts of a set kept after a first round.
const STARTS: usize = 2;

/// The most likely fits of each set of effects, all with the same noise.
fn leading_starts(mut fits: Vec<Candidate>) -> Vec<Candidate> {
    fits.sort_by(|a, b| b.fit.log_likelihood.total_cmp(&a.fit.log_likelihood));
    // Starts of one set have the same price, so their likelihoods are comparable.
    let mut kept: Vec<Candidate> = Vec::new();
    for c in fits {
        if kept.iter().filter(|k| k.effects() == c.effects()).count() < STARTS {
            kept.push(c);
        }
    }
    kept
}

/// The effects with the highest scores in addition to a candidate, each with its best shapes.
fn ranked_hits(
    problem: &Problem,
    parent: &Candidate,
    effects: &[usize],
    count: usize,
    shapes: usize,
) -> Vec<Vec<Hit>> {
    // A fit has a fixed number of columns, and an effect may need three.
    if parent.fit.model.free_count() + 3 > MAX_FIT_FREE {
        return Vec::new();
    }
    let screen = Screen::new(problem, &parent.fit);
    let taken = parent.effects();
    let mut free = effects.to_vec();
    free.retain(|e| {
        let spec = problem.catalogue[*e].effect_spec();
        !taken.iter().any(|t| problem.catalogue[*t].effect_spec().overlaps_with(spec))
    });
    let mut hits: Vec<Vec<Hit>> =
        free.par_iter().map(|e| screen.best_hits(*e, shapes)).filter(|h| !h.is_empty()).collect();
    // Minus the price of the parameters (14.15), since more parameters gain more by chance.
    let price = problem.independent_count().ln();
    let value = |h: &[Hit]| h[0].gain - price * h[0].p.len() as f64;
    hits.sort_by(|a, b| value(b).total_cmp(&value(a)));
    for (rank, hit) in hits.iter().enumerate() {
        let effect = problem.catalogue[hit[0].effect].name();
        debug!(effect, gain = hit[0].gain, worth = value(hit), tried = rank < count, "effect screened");
    }
    hits.truncate(count);
    hits
}

/// Start models of a fit: the parent with the effect added at its shape and at its restart points.
fn starts_of(problem: &Problem, parent: &Candidate, hit: &Hit) -> Vec<JointModel> {
    let effect = &problem.catalogue[hit.effect];
    let mut models = Vec::new();
    for p in effect.restart_points(&hit.p, &problem.coverage) {
        let mut model = parent.fit.model.with_effect(hit.effect, &p);
        // A delay replaces the lag.
        if effect.place() == Place::Delay {
            model.lag_s = 0.0;
        }
        models.push(model);
    }
    // The first friction comes with a settle time.
    if effect.place() != Place::Friction || parent.fit.model.has_friction(problem.catalogue) {
        return models;
    }
    let mut starts: Vec<JointModel> = models.clone();
    starts.iter_mut().for_each(|m| m.settle_s = SETTLE_S[2]);
    starts.extend(models);
    starts
}

/// The best candidate of each set of effects; the best set comes first.
#[must_use]
pub fn best_of_each_set(mut found: Vec<Candidate>) -> Vec<Candidate> {
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut sets: Vec<Candidate> = Vec::new();
    for c in found {
        if !sets.iter().any(|s| s.effects() == c.effects()) {
            sets.push(c);
        }
    }
    sets
}
