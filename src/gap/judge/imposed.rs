//! Joints whose motion was imposed: a door pulled slowly by a hand or a robot. Names come from the likelihood
//! of the efforts given the motion, and are proven on the efforts of held-out runs. See docs/method.md 14.17.

use nalgebra::DMatrix;
use rayon::prelude::*;
use tracing::debug;

use super::{
    assess::{Runs, all_tracks, unproven_report},
    finding::{Finding, findings_of_model},
    format_model::{Fate, FormatModel, HeldEffect},
    name_weight::{NAME_WEIGHT, in_doubt, least_gain},
    proof::{Gap, RunGap},
    report::JointReport,
    screen::amplitude_count,
    spread::Spread,
    verdict::{Diagnosis, Verdict, generalizes},
};
use crate::{
    fit::{
        inverse::{Explanation, ImposedMotion},
        noise::EffortNoise,
        problem::Problem,
    },
    model::{
        expressed::expressed_model,
        format::Format,
        joint_model::{Catalogue, JointModel, Term},
        plant::Plant,
    },
    record::{log::rms, off_axis::MAX_LEFT},
};

/// Most effects of a set. chosen: doors have a closer, a catch, a seal and a friction
const MOST_EFFECTS: usize = 4;
/// Shapes of an effect that are refined after the grid. chosen: neighbors on the grid lead to the same shape
const REFINED: usize = 3;
/// Steps by which a shape is refined, each half of the one before, as a share of its range.
/// chosen: from the spacing of the grid to well below any interval.
const STEPS: i32 = 7;

/// A set of effects with the efforts that it explains.
#[derive(Clone, Debug)]
struct ExplainedSet {
    terms: Vec<Term>,
    explanation: Explanation,
    /// Log evidence of independent moments, less the price of the shapes.
    score: f64,
    /// Gain of log likelihood over the twin's for independent efforts of held-out runs; 0 without any.
    unseen_gain: f64,
}

impl ExplainedSet {
    /// Indices of its effects, sorted.
    fn effects(&self) -> Vec<usize> {
        let mut effects: Vec<usize> = self.terms.iter().map(|t| t.effect).collect();
        effects.sort_unstable();
        effects
    }

    /// What the fitted and the held-out runs say together for it, beside other sets of its size.
    fn weight_log(&self) -> f64 {
        self.score + self.unseen_gain
    }
}

/// The report of a joint whose motion was imposed; `None` where efforts drive it, or given effects are of
/// another kind.
#[must_use]
pub fn imposed_report(effects: &Catalogue, plant: &Plant, name: &str, runs: &Runs) -> Option<JointReport> {
    let motion = ImposedMotion::of_logs(effects, plant, &runs.fitted, runs.hold)?;
    if !runs.effects.iter().all(|e| motion.is_law_of_motion(*e)) || !motion.is_imposed() {
        return None;
    }
    let problem = Problem::new(effects, plant, runs.turns, runs.fitted.clone(), runs.hold);
    let held_out = ImposedMotion::of_logs(effects, plant, &runs.held_out, runs.hold);
    let judge = Judge {
        target: motion.unexplained_efforts(),
        independent: motion.independent_share(),
        motion,
        problem: &problem,
        held_out,
    };
    let found = judge.diagnosis(&runs.effects);
    debug!(joint = name, verdict = found.verdict.name(), "the motion was imposed");
    let twin = JointModel::of_plant(plant);
    let mut report =
        unproven_report(name.to_owned(), runs.turns, found, all_tracks(runs), problem.coverage.clone());
    report.is_imposed = true;
    if let Some(held_out) = &judge.held_out {
        let updated = report.diagnosis.effects_or_nearest().clone();
        let gap = judge.gap(runs, &updated);
        report.in_format = judge.format_models(held_out, &report.diagnosis);
        match report.diagnosis.nearest {
            Some(_) => {
                report.gap = Some(judge.gap(runs, &twin));
                report.nearest = Some(gap);
            }
            None => report.gap = Some(gap),
        }
    }
    Some(report)
}

/// Efforts of a joint that effects are to explain.
struct Judge<'a, 'c> {
    motion: ImposedMotion<'c>,
    problem: &'a Problem<'c>,
    /// Efforts less what the twin needs, N m or N.
    target: Vec<f64>,
    /// Share of the moments that is independent.
    independent: f64,
    /// Motion and efforts of held-out runs.
    held_out: Option<ImposedMotion<'c>>,
}

impl Judge<'_, '_> {
    /// The effects that may be found: all whose efforts follow from the motion.
    fn sought_effects(&self) -> Vec<usize> {
        (0..self.problem.catalogue.len()).filter(|e| self.motion.is_law_of_motion(*e)).collect()
    }

    /// The set for which fitted and held-out runs say most, where held-out ones surely bear it out. One run
    /// may show more than is there in every run.
    fn diagnosis(&self, given: &[usize]) -> Diagnosis {
        let sets = self.grown_sets(given);
        let Some(largest) = sets.last() else {
            let twin = JointModel::of_plant(&self.problem.plant);
            return Diagnosis::without_findings(Verdict::Insufficient, twin);
        };
        if largest.terms.is_empty() {
            return self.diagnosis_of_set(largest, &[]);
        }
        let mut pool = if given.is_empty() { self.neighboring_sets(&sets) } else { vec![largest.clone()] };
        for set in &mut pool {
            set.unseen_gain = self.unseen_gain(set);
        }
        let price = self.price_of_effect();
        let value = |set: &ExplainedSet| set.weight_log() - price * set.terms.len() as f64;
        pool.sort_by(|a, b| value(b).total_cmp(&value(a)));
        let is_borne_out =
            |set: &&ExplainedSet| self.held_out.is_none() || set.unseen_gain > least_unseen_gain();
        for set in pool.iter().filter(is_borne_out) {
            let found = self.diagnosis_of_set(set, &pool);
            if !found.findings.is_empty() {
                return found;
            }
        }
        let mut found = self.diagnosis_of_set(largest, &[]);
        if found.nearest.is_none() {
            found.withdraw_names();
        }
        found
    }

    /// The grown sets, those with another effect in the place of one of theirs, and those with one less.
    fn neighboring_sets(&self, sets: &[ExplainedSet]) -> Vec<ExplainedSet> {
        let mut all: Vec<ExplainedSet> = Vec::new();
        for set in sets.iter().filter(|set| !set.terms.is_empty()) {
            all.push(set.clone());
            for place in 0..set.terms.len() {
                let mut others = set.terms.clone();
                others.remove(place);
                if !others.is_empty() {
                    all.extend(self.explained(others.clone()).map(|smaller| self.refined(smaller)));
                }
                all.extend(self.sought_effects().into_iter().filter_map(|e| self.with_effect(&others, e)));
            }
        }
        // Of sets with the same effects the best one.
        all.sort_by(|a, b| b.score.total_cmp(&a.score));
        let mut pool: Vec<ExplainedSet> = Vec::new();
        for set in all {
            if pool.iter().all(|known| known.effects() != set.effects()) {
                pool.push(set);
            }
        }
        pool
    }

    /// Log odds that an effect costs before the runs speak.
    fn price_of_effect(&self) -> f64 {
        0.5 * least_gain(self.sought_effects().len())
    }

    /// Gain of log likelihood over the twin's for the efforts of held-out runs; 0 without any.
    fn unseen_gain(&self, set: &ExplainedSet) -> f64 {
        let Some(held_out) = &self.held_out else { return 0.0 };
        let model = JointModel { terms: set.terms.clone(), ..JointModel::of_plant(&self.problem.plant) };
        let target = held_out.unexplained_efforts();
        let left = less_effects(held_out, &target, &model);
        let remainder_of = |efforts: &[f64]| self.motion.explanation(efforts, &[]).remainder;
        let own_left = less_effects(&self.motion, &self.target, &model);
        let before = held_out.log_likelihood(&target, &remainder_of(&self.target));
        self.independent * (held_out.log_likelihood(&left, &remainder_of(&own_left)) - before)
    }

    /// What a set of effects says.
    fn diagnosis_of_set(&self, chosen: &ExplainedSet, pool: &[ExplainedSet]) -> Diagnosis {
        let twin = JointModel::of_plant(&self.problem.plant);
        let remainder = chosen.explanation.remainder;
        let noise = EffortNoise {
            white: remainder.white_deviation(),
            wander: remainder.deviation * (1.0 - remainder.wander.white).sqrt(),
            memory_s: remainder.wander.length,
            deflection: 0.0,
        };
        let mut diagnosis = Diagnosis {
            score: 2.0 * chosen.score,
            noise,
            ..Diagnosis::without_findings(Verdict::None, twin.clone())
        };
        if chosen.terms.is_empty() {
            // The twin explains the efforts, or nothing does.
            if rms(&self.target) > MAX_LEFT * self.motion.effort_rms {
                diagnosis.verdict = Verdict::Unknown;
            }
            return diagnosis;
        }
        diagnosis.weighed = self.rivals(chosen, pool);
        let (rivals, total) = in_doubt(diagnosis.weighed.clone());
        diagnosis.verdict = if rivals.is_empty() { Verdict::Named } else { Verdict::Ambiguous };
        diagnosis.model = JointModel { terms: chosen.terms.clone(), ..twin };
        let spread = self.spread(chosen, &diagnosis.model);
        diagnosis.findings = findings_of_model(self.problem, &diagnosis.model, &spread, &rivals, total);
        diagnosis.spread = Some(spread);
        if !diagnosis.findings.iter().all(Finding::is_determined) {
            diagnosis.withdraw_names();
        }
        diagnosis
    }

    /// Terms with the amplitudes that explain most; `None` where an amplitude is beyond its bounds.
    fn explained(&self, mut terms: Vec<Term>) -> Option<ExplainedSet> {
        let mut columns = Vec::new();
        for term in &mut terms {
            let count = amplitude_count(self.problem.catalogue[term.effect].as_ref());
            term.p[..count].fill(0.0);
            columns.extend(self.motion.needed_by(term).1.into_iter().take(count));
        }
        let explanation = self.motion.explanation(&self.target, &columns);
        let mut amplitudes = explanation.amplitudes.iter();
        let mut shapes = 0;
        for term in &mut terms {
            let effect = &self.problem.catalogue[term.effect];
            let count = amplitude_count(effect.as_ref());
            for i in 0..count {
                let (low, high) = effect.parameter_bounds(i, &self.problem.coverage);
                term.p[i] = amplitudes.next().copied().filter(|a| (low..=high).contains(a))?;
            }
            shapes += term.p.len() - count;
        }
        let count = (self.independent * self.motion.moment_count() as f64).max(1.0);
        let price = 0.5 * count.ln() * shapes as f64;
        let score = self.independent * explanation.log_evidence - price;
        Some(ExplainedSet { terms, explanation, score, unseen_gain: 0.0 })
    }

    /// No effect, one, two ...: each set has one effect more, as long as each has the weight of a name; all
    /// `given` ones are taken.
    fn grown_sets(&self, given: &[usize]) -> Vec<ExplainedSet> {
        let sought = if given.is_empty() { self.sought_effects() } else { given.to_vec() };
        let least = if given.is_empty() { self.price_of_effect() } else { f64::NEG_INFINITY };
        let most = if given.is_empty() { MOST_EFFECTS } else { given.len() };
        let mut sets: Vec<ExplainedSet> = self.explained(Vec::new()).into_iter().collect();
        while let Some(last) = sets.last().filter(|last| last.terms.len() < most) {
            let larger = sought.iter().filter_map(|e| self.with_effect(&last.terms, *e));
            let best = larger.max_by(|a, b| a.score.total_cmp(&b.score));
            let Some(best) = best.filter(|best| best.score - last.score >= least) else { break };
            sets.push(best);
        }
        sets
    }

    /// The terms with one more effect of the best shape; `None` where it overlaps with one of them or helps
    /// nothing.
    fn with_effect(&self, terms: &[Term], effect: usize) -> Option<ExplainedSet> {
        let own = &self.problem.catalogue[effect];
        let spec = own.effect_spec();
        if terms.iter().any(|t| self.problem.catalogue[t.effect].effect_spec().overlaps_with(spec)) {
            return None;
        }
        let mut trials = Vec::new();
        for p in own.start_shapes(&self.problem.coverage) {
            let mut more = terms.to_vec();
            more.push(Term { effect, p });
            trials.push(more);
        }
        let mut tried: Vec<ExplainedSet> = trials.into_par_iter().filter_map(|t| self.explained(t)).collect();
        tried.sort_by(|a, b| b.score.total_cmp(&a.score));
        tried.truncate(REFINED);
        let refined = tried.into_par_iter().map(|found| self.refined(found)).collect::<Vec<ExplainedSet>>();
        refined.into_iter().max_by(|a, b| a.score.total_cmp(&b.score))
    }

    /// The shape of the last term moved to where the set explains most.
    fn refined(&self, mut found: ExplainedSet) -> ExplainedSet {
        let Some(term) = found.terms.last() else { return found };
        let effect = &self.problem.catalogue[term.effect];
        let shapes = amplitude_count(effect.as_ref())..term.p.len();
        let at = found.terms.len() - 1;
        for halvings in 2..2 + STEPS {
            for i in shapes.clone() {
                let (low, high) = effect.parameter_bounds(i, &self.problem.coverage);
                for direction in [-1.0, 1.0] {
                    let mut terms = found.terms.clone();
                    let moved = terms[at].p[i] + direction * (high - low) * f64::from(-halvings).exp2();
                    terms[at].p[i] = moved.clamp(low, high);
                    if let Some(other) = self.explained(terms).filter(|o| o.score > found.score) {
                        found = other;
                    }
                }
            }
        }
        found
    }

    /// Other sets of the same size, with their weights.
    fn rivals(&self, chosen: &ExplainedSet, pool: &[ExplainedSet]) -> Vec<(Vec<usize>, f64)> {
        let own = chosen.effects();
        let mut rivals = Vec::new();
        for other in pool.iter().filter(|other| other.terms.len() == own.len()) {
            let effects = other.effects();
            if effects != own && !generalizes(self.problem.catalogue, &effects, &own) {
                rivals.push((effects, (other.weight_log() - chosen.weight_log()).min(0.0).exp()));
            }
        }
        rivals
    }

    /// Uncertainty of the model's parameters.
    fn spread(&self, chosen: &ExplainedSet, model: &JointModel) -> Spread {
        let slopes: Vec<Vec<f64>> = chosen.terms.iter().flat_map(|t| self.motion.needed_by(t).1).collect();
        let count = model.free_count();
        let mut covariance = DMatrix::zeros(count, count);
        match self.motion.covariance(&slopes, &chosen.explanation.remainder) {
            // Parameter 0 is the lag, which has no part in slow motion.
            Some(own) => {
                covariance.view_mut((1, 1), (slopes.len(), slopes.len())).copy_from(&(own / self.independent))
            }
            None => (1..count).for_each(|i| covariance[(i, i)] = f64::INFINITY),
        }
        Spread { covariance, witnesses: vec![self.independent * self.motion.moment_count() as f64; count] }
    }

    /// Efforts of held-out runs left by the twin and by a model.
    fn gap(&self, runs: &Runs, model: &JointModel) -> Gap {
        let mut all = [Vec::new(), Vec::new()];
        let mut gaps = Vec::with_capacity(runs.held_out.len());
        let Problem { catalogue, plant, .. } = self.problem;
        for log in &runs.held_out {
            let one = std::slice::from_ref(log);
            let Some(motion) = ImposedMotion::of_logs(catalogue, plant, one, runs.hold) else {
                continue;
            };
            let before = motion.unexplained_efforts();
            let after = less_effects(&motion, &before, model);
            gaps.push(RunGap {
                run: log.run.clone(),
                before: rms(&before),
                after: rms(&after),
                full_before: rms(&before),
                full_after: rms(&after),
            });
            all[0].extend(before);
            all[1].extend(after);
        }
        let own_left = less_effects(&self.motion, &self.target, model);
        let noise_floor = self.motion.explanation(&own_left, &[]).remainder.white_deviation();
        Gap { before: rms(&all[0]), after: rms(&all[1]), noise_floor, runs: gaps, windows: Vec::new() }
    }

    /// The joint in each format: what it can hold of the effects.
    fn format_models(&self, held_out: &ImposedMotion, found: &Diagnosis) -> Vec<FormatModel> {
        let catalogue = self.problem.catalogue;
        let target = held_out.unexplained_efforts();
        let mut models = Vec::new();
        for format in Format::ALL.into_iter().filter(|_| !found.model.terms.is_empty()) {
            let model = expressed_model(format, &found.model, catalogue);
            models.push(FormatModel {
                format,
                rmse: rms(&less_effects(held_out, &target, &model)),
                twin_rmse: rms(&target),
                effects: found
                    .model
                    .terms
                    .iter()
                    .map(|t| held_effect(format, t, &found.model, catalogue))
                    .collect(),
                model,
            });
        }
        models
    }
}

/// What a format holds of a term.
fn held_effect(format: Format, term: &Term, model: &JointModel, catalogue: &Catalogue) -> HeldEffect {
    let alone = JointModel { terms: vec![term.clone()], ..model.clone() };
    let by = expressed_model(format, &alone, catalogue).terms;
    let (fate, by) = match by.as_slice() {
        [] => (Fate::NotExpressible, by),
        [same] if same == term => (Fate::Native, Vec::new()),
        _ => (Fate::Approximated, by),
    };
    HeldEffect { effect: Some(term.effect), fate, by }
}

/// Gain of log likelihood from which held-out runs bear a set out.
fn least_unseen_gain() -> f64 {
    (NAME_WEIGHT / (1.0 - NAME_WEIGHT)).ln()
}

/// What a model's effects leave of efforts that the twin leaves.
fn less_effects(motion: &ImposedMotion, target: &[f64], model: &JointModel) -> Vec<f64> {
    let mut left = target.to_vec();
    for term in &model.terms {
        for (left, needed) in left.iter_mut().zip(motion.needed_by(term).0) {
            *left -= needed;
        }
    }
    left
}

#[cfg(test)]
#[path = "imposed_tests.rs"]
mod tests;
