//! Which set of effects explains the logs best: singles, then pairs and triples grown from several of them.

use rayon::prelude::*;

use crate::{
    fit::{
        noise::EffortNoise,
        problem::{Problem, Weighing},
        rollout::Start,
        shooting::{Fit, Free, MAX_FIT_FREE, Pace, fit},
        smooth::Trace,
    },
    judge::{
        exchange::exchanged,
        regression::regressed_sets,
        screen::{Hit, Screen},
    },
    model::{
        effect::{At, Place, Response, Spec, run_time_s},
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
        self.fit.model.effects()
    }
}

/// How wide the search is.
#[derive(Clone, Copy, Debug)]
pub struct Breadth {
    /// Effects that are fitted alone.
    pub singles: usize,
    /// Sets of each size that are grown.
    pub grown: usize,
    /// Effects tried beside each of them.
    pub partners: usize,
    /// Largest set.
    pub largest: usize,
    /// Largest set that is regressed, where whole windows are predicted.
    pub regressed: usize,
}

impl Default for Breadth {
    fn default() -> Self {
        Self { singles: 9, grown: 3, partners: 5, largest: 3, regressed: 4 }
    }
}

/// What a search may find.
#[derive(Clone, Copy, Debug)]
pub struct Scope<'a> {
    /// Indices of effects in the catalogue.
    pub effects: &'a [usize],
    /// Sets that are tried beside those that grow one by one; the fits begin at their parameters.
    pub seeds: &'a [JointModel],
    /// Gain of score that one more effect must bring.
    pub least_gain: f64,
}

/// Sets by size: index 0 holds the twin itself, then singles, pairs, ...; each sorted, best first.
#[derive(Debug)]
pub struct Search {
    /// Candidates by the number of effects.
    pub by_size: Vec<Vec<Candidate>>,
    /// Index of the disturbance in the catalogue.
    pub disturbance: Option<usize>,
    /// Gain of score that one more effect must bring.
    pub least_gain: f64,
}

impl Search {
    /// The smallest set that no larger one beats by what one more effect must bring.
    #[must_use]
    pub fn accepted(&self) -> &Candidate {
        let nothing = self.by_size[0][0].score;
        let mut best = &self.by_size[0][0];
        for sets in self.by_size.iter().skip(1) {
            let gained = best.score - nothing;
            let is_push = |c: &Candidate| {
                c.fit.model.terms.len() > 1 && self.disturbance.is_some_and(|d| c.effects().contains(&d))
            };
            // One window that was misread looks like a push: it must bring more than may be left.
            let wanted =
                |c: &Candidate| self.least_gain.max(gained * if is_push(c) { MAX_LEFT } else { MIN_SHARE });
            let enough = |c: &&Candidate| c.score > best.score + wanted(c);
            // Sets behind the finalists were not fitted to the end.
            if let Some(first) = sets.iter().take(FINALISTS).find(enough) {
                best = first;
            }
        }
        best
    }
}

/// What a set of effects costs: each parameter, and each choice of shape. See docs/method.md (14.15).
#[must_use]
pub fn price(problem: &Problem, model: &JointModel) -> f64 {
    let n = problem.independent();
    let one = |t: &Term| {
        let shapes = problem.catalogue[t.effect].shapes(&problem.coverage).len().max(1) as f64;
        t.p.len() as f64 * n.ln() + 2.0 * shapes.ln()
    };
    model.terms.iter().map(one).sum()
}

/// A fit with its score.
#[must_use]
pub fn candidate(problem: &Problem, fit: Fit) -> Candidate {
    let score = 2.0 * fit.log_likelihood - price(problem, &fit.model);
    // An effect that stands alone may be weak: there is no other whose shape it could mend.
    let whole = fit.model.terms.len() < 2
        || (fit.model.terms.iter().all(|t| is_felt(problem, t)) && !mends_fall(problem, &fit.model));
    Candidate { score: if score.is_finite() && whole { score } else { f64::NEG_INFINITY }, fit }
}

/// Effort, as a share of the recorded efforts' root mean square, that an effect beside others must reach
/// somewhere. What is smaller mends the shape of the others.
/// tuned: tests/python/gap/generate.py.
const MIN_FELT: f64 = 0.02;

/// Whether efforts of the velocity alone stand beside a friction that falls with speed and are smaller than
/// what an explanation of that fall may leave: they mend its shape, of which the laws in use know no more.
fn mends_fall(problem: &Problem, model: &JointModel) -> bool {
    let of = |t: &Term| &problem.catalogue[t.effect];
    let fall = model.terms.iter().map(|t| of(t).fall(&t.p)).fold(0.0, f64::max);
    let mut by_velocity = model.terms.iter().filter(|t| of(t).is_of_velocity()).peekable();
    if fall <= 0.0 || by_velocity.peek().is_none() {
        return false;
    }
    let menders: Vec<&Term> = by_velocity.collect();
    let effort = |v: f64| -> f64 {
        let at = At { v, direction: 1.0, ..At::default() };
        let one = |t: &&Term| {
            let mut response = Response::default();
            of(t).respond(&at, &t.p, &mut response);
            response.value
        };
        menders.iter().map(one).sum()
    };
    let top = problem.coverage.speed.1;
    // derived: tenths of the top speed.
    (1..=10).all(|i| effort(0.1 * f64::from(i) * top).abs() < MAX_LEFT * fall)
}

/// Whether an effort or a friction is strong enough to stand beside other effects.
fn is_felt(problem: &Problem, term: &Term) -> bool {
    let effect = &problem.catalogue[term.effect];
    if !matches!(effect.place(), Place::Effort | Place::Contact | Place::Friction) {
        return true;
    }
    let least = MIN_FELT * problem.coverage.effort_rms;
    let strong = |(index, trace): (usize, &Trace)| {
        let log = &problem.logs[index];
        let mut others = [0.0; 8];
        (0..trace.position.len()).step_by(3).any(|k| {
            for (x, other) in others.iter_mut().zip(&log.others) {
                *x = other[k];
            }
            let direction = if trace.velocity[k] < 0.0 { -1.0 } else { 1.0 };
            let t = run_time_s(index, log, k);
            let at = At {
                q: trace.position[k],
                v: trace.velocity[k],
                u: trace.effort[k],
                feedback: [0.0; 2],
                t,
                direction,
                others: &others,
                load: 0.0,
                carried: log.carried.get(k),
            };
            let mut response = Response::default();
            effect.respond(&at, &term.p, &mut response);
            response.value.abs() >= least
        })
    };
    problem.traces.iter().enumerate().any(strong)
}

/// Effort noise that a fit begins with, as a share of the recorded effort.
/// chosen: a start value, which the fit replaces.
const FIRST_NOISE: f64 = 0.02;

/// The twin as it is, with its start states and noise fitted.
#[must_use]
pub fn baseline(problem: &Problem) -> Candidate {
    let guess = EffortNoise::white(FIRST_NOISE * problem.coverage.effort_rms.max(problem.min_sigma_u * 10.0));
    candidate(
        problem,
        fit(problem, &JointModel::of(&problem.plant), None, guess, Free::All, Pace::thorough(3)),
    )
}

/// Searches sets of effects up to `breadth.largest`; stops growing where one more effect brings too little.
#[must_use]
pub fn search(problem: &Problem, breadth: &Breadth, scope: &Scope) -> Search {
    let disturbance = scope.effects.iter().copied().find(|e| problem.catalogue[*e].is_of_one_run());
    let least_gain = scope.least_gain;
    let base = baseline(problem);
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
            // Only the best pair grows: what a third effect adds is small beside it.
            _ => (1, breadth.partners - 1),
        };
        let best_before = best_score(&by_size);
        // One more effect must bring a share of what the others brought: an inexact shape is no further
        // effect.
        let wanted = least_gain.max(MIN_SHARE * (best_before - nothing));
        let mut found: Vec<Candidate> = Vec::new();
        for (rank, parent) in distinct(problem, &by_size[size - 1], grown).into_iter().enumerate() {
            let hits = ranked(problem, parent, scope.effects, tried, if size == 1 { 2 } else { 1 });
            let hope = hits.first().map_or(f64::NEG_INFINITY, |h| h[0].gain);
            // Not even the first order promises enough beside the best set.
            if rank == 0 && hope < least_gain {
                break;
            }
            found.extend(grow(problem, parent, &hits));
        }
        let of_size: Vec<&JointModel> = seeds.iter().filter(|s| s.terms.len() == size).collect();
        found.extend(of_size.par_iter().map(|s| begun(problem, &by_size[0][0], s)).collect::<Vec<_>>());
        if found.is_empty() && size >= largest_seed {
            break;
        }
        let mut sets = best_of_each_set(found);
        if size > 1 && problem.weighing != Weighing::Innovations {
            sets = with_exchanges(problem, &by_size[0][0], sets, &by_size[1]);
        }
        let best = sets.first().map_or(f64::NEG_INFINITY, |c| c.score);
        // Growing one by one misses sets whose members show only beside each other.
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

/// Score of the best set.
fn best_score(by_size: &[Vec<Candidate>]) -> f64 {
    by_size.iter().filter_map(|s| s.first()).map(|c| c.score).fold(f64::NEG_INFINITY, f64::max)
}

/// A set that begins at given parameters, fitted to the end.
#[must_use]
pub fn begun(problem: &Problem, base: &Candidate, seed: &JointModel) -> Candidate {
    let pace = Pace { searches: true, ..Pace::NEXT };
    let begun = fit(problem, seed, Some(&base.fit.starts), base.fit.noise, Free::All, pace);
    let starts = Some(begun.starts.as_slice());
    let noise = begun.noise;
    candidate(problem, fit(problem, &begun.model, starts, noise, Free::All, Pace::thorough(3)))
}

/// Sets with, beside them, the best of them with each of its effects in exchange for each of those that lead
/// alone. Fits begin at the start states of `base`.
fn with_exchanges(
    problem: &Problem,
    base: &Candidate,
    sets: Vec<Candidate>,
    singles: &[Candidate],
) -> Vec<Candidate> {
    let Some(best) = sets.first() else { return sets };
    let others: Vec<&JointModel> = singles.iter().take(FINALISTS).map(|c| &c.fit.model).collect();
    let known = |effects: &[usize]| sets.iter().any(|s| s.effects() == effects);
    let seeds = exchanged(problem.catalogue, &best.fit.model, &others, known);
    let fitted: Vec<Candidate> = seeds.par_iter().map(|s| begun(problem, base, s)).collect();
    best_of_each_set(sets.into_iter().chain(fitted).collect())
}

/// The best candidates, of those that differ by an effect and one that contains it the better one.
fn distinct<'c>(problem: &Problem, candidates: &'c [Candidate], count: usize) -> Vec<&'c Candidate> {
    let mut chosen: Vec<&Candidate> = Vec::new();
    for c in candidates {
        if chosen.len() < count && !chosen.iter().any(|o| is_related(problem, o, c)) {
            chosen.push(c);
        }
    }
    chosen
}

/// Whether two sets differ by one effect and one that contains it.
fn is_related(problem: &Problem, a: &Candidate, b: &Candidate) -> bool {
    let only = |one: &Candidate, other: &Candidate| -> Vec<&'static Spec> {
        let of =
            |c: &Candidate| c.effects().into_iter().map(|e| problem.catalogue[e].spec()).collect::<Vec<_>>();
        let known = of(other);
        of(one).into_iter().filter(|s| !known.iter().any(|o| o.name == s.name)).collect()
    };
    match (only(a, b).as_slice(), only(b, a).as_slice()) {
        ([x], [y]) => x.overlaps(y),
        _ => false,
    }
}

/// The candidate with each of its effects taken away in turn, refitted; not what is known already.
fn without_one(problem: &Problem, candidate_: &Candidate, known: &[Candidate]) -> Vec<Candidate> {
    let is_new = |i: &usize| {
        let mut left: Vec<usize> = candidate_.fit.model.terms.iter().map(|t| t.effect).collect();
        left.remove(*i);
        left.sort_unstable();
        !known.iter().any(|k| k.effects() == left)
    };
    let one = |i: usize| {
        let mut model = candidate_.fit.model.clone();
        model.terms.remove(i);
        let begun =
            fit(problem, &model, Some(&candidate_.fit.starts), candidate_.fit.noise, Free::All, Pace::NEXT);
        let starts = Some(begun.starts.as_slice());
        let noise = begun.noise;
        candidate(problem, fit(problem, &begun.model, starts, noise, Free::All, Pace::thorough(3)))
    };
    (0..candidate_.fit.model.terms.len()).into_par_iter().filter(is_new).map(one).collect()
}

/// Share of the gain so far that one more effect must add.
/// tuned: tests/python/gap/generate.py.
const MIN_SHARE: f64 = 0.04;
/// Candidates that are fitted to the end after a first pass over all.
const FINALISTS: usize = 5;

/// Fits in a row that a candidate with play may take.
const PLAY_FITS: usize = 3;
/// What each must gain for the next.
/// chosen: with a gain of one in the log likelihood, a parameter moves by 1.4 of its standard deviations.
const MIN_GAIN_OF_PLAY_FIT: f64 = 2.0;

/// Fits a parent with each of the hits; those that lead after a first round are fitted to the end.
#[must_use]
pub fn grow(problem: &Problem, parent: &Candidate, hits: &[Vec<Hit>]) -> Vec<Candidate> {
    let jobs: Vec<JointModel> = hits.iter().flatten().flat_map(|h| starts_of(problem, parent, h)).collect();
    let first = |m: &JointModel| {
        let seen = parent.fit.model.sensor(problem.catalogue);
        let sees = m.sensor(problem.catalogue);
        // The same measured start, through the new sensor.
        let start = |s: &Start| {
            let measured = seen.scale * (s.position + s.play * seen.half_gap) + seen.bias;
            let position = (measured - sees.bias) / sees.scale - s.play * sees.half_gap;
            Start { position, velocity: s.velocity * seen.scale / sees.scale, play: s.play }
        };
        let starts: Vec<Start> = parent.fit.starts.iter().map(start).collect();
        candidate(problem, fit(problem, m, Some(&starts), parent.fit.noise, Free::All, Pace::FIRST))
    };
    let next = |c: &Candidate| {
        let on = candidate(
            problem,
            fit(problem, &c.fit.model, Some(&c.fit.starts), c.fit.noise, Free::All, Pace::NEXT),
        );
        if on.score > c.score { on } else { c.clone() }
    };
    let begun = leading_starts(jobs.par_iter().map(first).collect());
    let mut fits: Vec<Candidate> = best_of_each_set(begun.par_iter().map(next).collect());
    let further = |c: &Candidate| {
        let again =
            fit(problem, &c.fit.model, Some(&c.fit.starts), c.fit.noise, Free::All, Pace::thorough(2));
        let again = candidate(problem, again);
        if again.score > c.score { again } else { c.clone() }
    };
    // Play is found window by window; under the smaller noise of a better fit more of them find their side of
    // the gap.
    let has_play = |c: &Candidate| c.fit.model.sensor(problem.catalogue).half_gap > 0.0;
    let gains = |c: &Candidate| c.score >= parent.score;
    let end = |c: &Candidate| {
        let alone = has_play(c) && parent.fit.model.terms.is_empty();
        let mut now = if gains(c) || alone { further(c) } else { return c.clone() };
        for _ in 1..PLAY_FITS {
            let next = if has_play(&now) && gains(&now) { further(&now) } else { return now };
            if next.score < now.score + MIN_GAIN_OF_PLAY_FIT {
                return next;
            }
            now = next;
        }
        now
    };
    let ended: Vec<Candidate> = fits[..fits.len().min(FINALISTS)].par_iter().map(end).collect();
    fits.splice(..ended.len(), ended);
    fits
}

/// Starts of a fit that go on after a first round.
const STARTS: usize = 2;

/// The most likely fits of each set of effects, all of them under the same noise.
fn leading_starts(mut fits: Vec<Candidate>) -> Vec<Candidate> {
    fits.sort_by(|a, b| b.fit.log_likelihood.total_cmp(&a.fit.log_likelihood));
    // Starts of one set pay the same price, so that their likelihoods compare.
    let mut kept: Vec<Candidate> = Vec::new();
    for c in fits {
        if kept.iter().filter(|k| k.effects() == c.effects()).count() < STARTS {
            kept.push(c);
        }
    }
    kept
}

/// Best shapes, so many of each, of the effects that score best beside a candidate.
fn ranked(
    problem: &Problem,
    parent: &Candidate,
    effects: &[usize],
    count: usize,
    shapes: usize,
) -> Vec<Vec<Hit>> {
    // A fit has a fixed number of columns, and an effect may need three more.
    if parent.fit.model.free() + 3 > MAX_FIT_FREE {
        return Vec::new();
    }
    let screen = Screen::new(problem, &parent.fit);
    let taken = parent.effects();
    let overlaps =
        |e: usize| taken.iter().any(|t| problem.catalogue[*t].spec().overlaps(problem.catalogue[e].spec()));
    let free: Vec<usize> = effects.iter().copied().filter(|e| !overlaps(*e)).collect();
    let mut hits: Vec<Vec<Hit>> =
        free.par_iter().map(|e| screen.hits(*e, shapes)).filter(|h| !h.is_empty()).collect();
    let n = problem.independent();
    // Less the price of the parameters (14.15): more of them gain more by chance.
    let value = |h: &[Hit]| h[0].gain - n.ln() * h[0].p.len() as f64;
    hits.sort_by(|a, b| value(b).total_cmp(&value(a)));
    hits.truncate(count);
    hits
}

/// Models that a fit starts from: the parent with the effect at its shape and at its restarts.
fn starts_of(problem: &Problem, parent: &Candidate, hit: &Hit) -> Vec<JointModel> {
    let effect = &problem.catalogue[hit.effect];
    let with = |p: &Vec<f64>| {
        let mut model = parent.fit.model.with(hit.effect, p);
        // A delay takes the place of the lag.
        if effect.place() == Place::Delay {
            model.lag_s = 0.0;
        }
        model
    };
    let models: Vec<JointModel> = effect.restarts(&hit.p, &problem.coverage).iter().map(with).collect();
    // The first friction brings its settle time along.
    if effect.place() != Place::Friction || parent.fit.model.has_friction(problem.catalogue) {
        return models;
    }
    let softly = |m: &JointModel| JointModel { settle_s: SETTLE_S[2], ..m.clone() };
    models.iter().map(softly).chain(models.clone()).collect()
}

/// One candidate a set of effects, the best of each; best set first.
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
