//! Draws the conclusion: agreement, one name, several possible names, an unknown cause, or too little motion
//! for any of these.

use rand_core::Rng;
use tracing::debug;

use crate::{
    fit::{
        noise::EffortNoise,
        problem::{Problem, Weighing},
        shooting::{Fit, Free, Pace, shooting_fit},
    },
    judge::{
        breadth::Breadth,
        cross_validation::{model_richness, predicted_weights, predictive_set},
        finding::{
            Finding, ParameterEstimate, actuator_estimates, findings_of_model, weight_and_alternatives,
        },
        given::given_set,
        locate::{Dependence, Variable, dependences_by_strength},
        name_weight::{in_doubt, least_gain},
        offset::with_offset,
        refined::refined_model,
        screen::Screen,
        search::{Candidate, Scope, Search, searched_sets},
        simplify::{refitted_set, simplified_set},
        spread::Spread,
        sure::is_surely_there,
    },
    model::{
        effect::{Coverage, Place},
        joint_model::{Catalogue, JointModel, Term},
        plant::LEAST_CHANGE,
    },
    record::{off_axis::MAX_LEFT, standing::is_motion},
};
use numeric::statistics::HALF_WIDTH_95;

/// Conclusion of a diagnosis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The twin agrees with the recording.
    None,
    /// Effects were identified by name.
    Named,
    /// Several effects are possible; the recording does not distinguish them.
    Ambiguous,
    /// No effect of the catalogue explains the disagreement.
    Unknown,
    /// The recording is insufficient for a diagnosis.
    Insufficient,
}

impl Verdict {
    /// Name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Named => "named",
            Self::Ambiguous => "ambiguous",
            Self::Unknown => "unknown",
            Self::Insufficient => "insufficient",
        }
    }
}

/// The diagnosis of one joint.
#[derive(Clone, Debug)]
pub struct Diagnosis {
    /// Verdict.
    pub verdict: Verdict,
    /// Effects found.
    pub findings: Vec<Finding>,
    /// Variables on which the disagreement of twin and recording depends, strongest first.
    pub before: Vec<Dependence>,
    /// The updated model; the twin itself if nothing is named.
    pub model: JointModel,
    /// Share of the explainable gain left unexplained.
    pub left: f64,
    /// What the recording lacks, as sentences for the user.
    pub lacks: Vec<String>,
    /// Twice the log likelihood of the model, less the price of its parameters and shapes.
    pub score: f64,
    /// Unexplained effort.
    pub noise: EffortNoise,
    /// Fitted actuator parameters: gain or stiffness, damping, delay.
    pub actuator: Vec<ParameterEstimate>,
    /// Under [`Verdict::Unknown`]: the nearest effects, explaining too little to be named.
    pub nearest: Option<Nearest>,
    /// Uncertainty of the parameters of the model, or of the nearest effects; `None` if there are none.
    pub spread: Option<Spread>,
    /// Sets of the same size with their weights, the chosen one included.
    pub weighed: Vec<(Vec<usize>, f64)>,
}

/// The effects nearest to an explanation.
#[derive(Clone, Debug)]
pub struct Nearest {
    /// The effects.
    pub findings: Vec<Finding>,
    /// The twin with them.
    pub model: JointModel,
}

impl Diagnosis {
    /// A verdict without findings, about a model.
    #[must_use]
    pub fn without_findings(verdict: Verdict, model: JointModel) -> Self {
        Self {
            verdict,
            findings: Vec::new(),
            before: Vec::new(),
            model,
            left: 0.0,
            lacks: Vec::new(),
            score: 0.0,
            noise: EffortNoise::default(),
            actuator: Vec::new(),
            nearest: None,
            spread: None,
            weighed: Vec::new(),
        }
    }

    /// Takes over the weights of sets of the same size from another search, if it contains the set found. No
    /// other set gets more weight than this one.
    pub fn weigh_as(&mut self, catalogue: &Catalogue, weighed: &[(Vec<usize>, f64)]) {
        let mut own: Vec<usize> = self.findings.iter().map(|f| f.index).collect();
        own.sort_unstable();
        let Some((_, weight)) = weighed.iter().find(|(effects, _)| *effects == own) else { return };
        let others = weighed.iter().filter(|(effects, _)| *effects != own && effects.len() == own.len());
        let rivals: Vec<(Vec<usize>, f64)> =
            others.map(|(effects, other)| (effects.clone(), (other / weight).min(1.0))).collect();
        let (rivals, total) = in_doubt(rivals);
        for finding in &mut self.findings {
            (finding.weight, finding.alternatives) =
                weight_and_alternatives(catalogue, &own, finding.index, &rivals, total);
        }
        if self.verdict == Verdict::Named && !rivals.is_empty() {
            self.verdict = Verdict::Ambiguous;
        }
    }

    /// Withdraws the names, since they explain too little.
    pub fn withdraw_names(&mut self) {
        let twin = self.model.without_effects();
        let model = std::mem::replace(&mut self.model, twin);
        self.nearest = Some(Nearest { findings: std::mem::take(&mut self.findings), model });
        self.verdict = Verdict::Unknown;
    }

    /// Marks each found effect as certainly present or not, if something remains beyond noise.
    pub fn mark_sure_effects(&mut self, catalogue: &Catalogue) {
        if let Some(spread) = self.spread.as_ref().filter(|_| self.noise.has_remainder()) {
            for (finding, (at, term)) in self.findings.iter_mut().zip(self.model.placed_terms()) {
                finding.is_sure = is_surely_there(catalogue, spread, at, term);
            }
        }
    }

    /// Effects certainly present.
    pub fn sure_findings(&self) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(|f| f.is_sure)
    }

    /// Effects possibly absent.
    pub fn unsure_findings(&self) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(|f| !f.is_sure)
    }

    /// Whether the motion was sufficient for a diagnosis.
    #[must_use]
    pub fn is_sufficient(&self) -> bool {
        self.verdict != Verdict::Insufficient
    }

    /// The model with the findings, or with the nearest effects.
    #[must_use]
    pub fn effects_or_nearest(&self) -> &JointModel {
        self.nearest.as_ref().map_or(&self.model, |n| &n.model)
    }

    /// Takes over refitted effects; some of the former ones may be missing.
    pub fn fit_again(&mut self, problem: &Problem, model: JointModel, spread: Spread, is_given: bool) {
        let own = self.nearest.as_mut().map_or(&mut self.findings, |n| &mut n.findings);
        let mut again = findings_of_model(problem, &model, &spread, &[], 1.0);
        for finding in &mut again {
            if let Some(known) = own.iter().find(|f| f.index == finding.index) {
                (finding.weight, finding.alternatives) = (known.weight, known.alternatives.clone());
            }
        }
        *own = again;
        self.spread = Some(spread);
        match &mut self.nearest {
            Some(_) if model.terms.is_empty() => (self.nearest, self.model) = (None, model),
            Some(nearest) => nearest.model = model,
            None => self.model = model,
        }
        if self.nearest.is_none() && self.findings.is_empty() {
            self.verdict = if self.noise.has_remainder() { Verdict::Unknown } else { Verdict::None };
        }
        if !is_given {
            self.mark_sure_effects(problem.catalogue);
        }
        let is_open = !self.findings.iter().all(Finding::is_determined);
        let is_unsure = self.sure_findings().next().is_none();
        if self.nearest.is_none() && !self.findings.is_empty() && (is_open || is_unsure) {
            self.withdraw_names();
        }
    }
}

/// Significance level for a table of the residual.
/// chosen: the accepted share of false alarms.
const LEVEL: f64 = 0.01;
/// Least credible delay, in sample intervals.
/// chosen: a smaller one may be a discretization error.
const LEAST_DELAY: f64 = 0.25;

/// What the motion lacks for any diagnosis, as sentences telling the user what to record.
#[must_use]
pub fn missing_motion(coverage: &Coverage, windows: usize) -> Vec<String> {
    let mut lacks = Vec::new();
    let duration: f64 = coverage.durations_s.iter().sum();
    if duration < 4.0 || windows < 4 {
        lacks.push(format!(
            "{duration:.1} s of motion are left to fit; record 10 s or more, in two runs or more"
        ));
    }
    let range = coverage.travel;
    if !is_motion(range, coverage.position_noise) {
        lacks.push(format!(
            "the position moves {range:.2e}, hardly more than its noise of {:.1e}; move the joint through \
             most of its range",
            coverage.position_noise
        ));
    }
    lacks
}

/// Diagnoses a joint from its fitted runs. Given `effects`, as catalogue indices, are fitted and nothing else
/// is searched; a search also tries the sets `seeds`.
#[must_use]
pub fn diagnose(problem: &Problem, effects: &[usize], seeds: &[JointModel], rng: &mut impl Rng) -> Diagnosis {
    let lacks = missing_motion(&problem.coverage, problem.windows.len());
    if !lacks.is_empty() {
        let nothing =
            Diagnosis::without_findings(Verdict::Insufficient, JointModel::of_plant(&problem.plant));
        return Diagnosis { lacks, ..nothing };
    }
    let (found, chosen) = chosen(problem, effects, seeds);
    let chosen = &chosen;
    let base = &found.by_size[0][0];
    let twin = base.fit.model.without_effects();
    // The twin with the noise of the chosen model shows how much there is to explain.
    let at_noise = shooting_fit(
        problem,
        &twin,
        Some(&base.fit.starts),
        chosen.fit.noise,
        Free::Starts,
        Pace::thorough(1),
    );
    let to_explain = gain_to_explain(&at_noise, &base.fit, &chosen.fit);
    let after = dependences_by_strength(problem, &Screen::new(problem, &chosen.fit), rng);
    let before = if chosen.fit.model.terms.is_empty() {
        after.clone()
    } else {
        dependences_by_strength(problem, &Screen::new(problem, &base.fit), rng)
    };
    let unexplained = unexplained_gain(&after, problem.independent_count());
    let nothing = Diagnosis::without_findings(Verdict::None, twin);
    let mut diagnosis = Diagnosis { before, lacks, score: chosen.score, noise: chosen.fit.noise, ..nothing };
    if chosen.fit.model.terms.is_empty() {
        let Fit { covariance, witnesses, model, .. } = &base.fit;
        let spread = Spread { covariance: covariance.clone(), witnesses: witnesses.clone() };
        diagnosis.actuator = actuator_estimates(model, &spread, problem.turns);
        // The residual depends on a variable, but no effect of the catalogue explains it.
        if unexplained > 0.0 {
            (diagnosis.verdict, diagnosis.left) = (Verdict::Unknown, 1.0);
        }
        return diagnosis;
    }
    diagnosis.left = share_left(unexplained, to_explain);
    diagnosis.weighed = rivals(problem, &found, chosen);
    let (rivals, total) = in_doubt(diagnosis.weighed.clone());
    diagnosis.weighed.push((chosen.effects(), 1.0));
    diagnosis.verdict = if rivals.is_empty() { Verdict::Named } else { Verdict::Ambiguous };
    let effects_found = chosen.fit.model.effect_names(problem.catalogue);
    debug!(effects = ?effects_found, rivals = rivals.len(), total, left = diagnosis.left, "names weighed");
    let (model, spread) = refined_model(problem, &chosen.fit);
    let (model, spread) = with_offset(problem, model, spread, effects);
    diagnosis.findings = findings_of_model(problem, &model, &spread, &rivals, total);
    diagnosis.actuator = actuator_estimates(&model, &spread, problem.turns);
    (diagnosis.model, diagnosis.spread) = (model, Some(spread));
    let mut keeps = diagnosis.findings.iter().all(Finding::is_determined);
    // What given effects explain is judged by the held-out runs only.
    if effects.is_empty() {
        diagnosis.mark_sure_effects(problem.catalogue);
        keeps &= !explains_too_little(problem, &diagnosis, base, chosen);
    }
    debug!(effects = ?effects_found, keeps, left = diagnosis.left, "names kept or taken back");
    if !keeps {
        diagnosis.withdraw_names();
    }
    diagnosis
}

/// Twice the gain of log likelihood of a model over the twin: from smaller residuals under the model's noise,
/// or, if a joint sticks and its residuals stay small, with each under its own noise.
fn gain_to_explain(twin_at_noise: &Fit, twin: &Fit, chosen: &Fit) -> f64 {
    let saved = twin_at_noise.costs.iter().sum::<f64>() - chosen.costs.iter().sum::<f64>();
    saved.max(2.0 * (chosen.log_likelihood - twin.log_likelihood))
}

/// The largest gain promised by a table of the residual over a variable, or 0 if none is significant. Tables
/// follow the rule for effects: bins are priced like parameters, docs/method.md (14.15), and the gain must
/// suffice for one more effect among as many tables.
fn unexplained_gain(tables: &[Dependence], independent: f64) -> f64 {
    let least = least_gain(Variable::ALL.len());
    let standing = tables.iter().filter(|t| t.q <= LEVEL);
    let gains = standing.map(|t| t.gain - independent.ln() * t.bins.len() as f64);
    gains.filter(|gain| *gain > least).fold(0.0, f64::max)
}

/// Share of the explainable gain left unexplained, at most 1.
fn share_left(unexplained: f64, to_explain: f64) -> f64 {
    (unexplained / to_explain.max(1e-9)).min(1.0)
}

/// Whether the effects found leave too much unexplained to be named.
fn explains_too_little(
    problem: &Problem,
    diagnosis: &Diagnosis,
    base: &Candidate,
    chosen: &Candidate,
) -> bool {
    let leaves_noise = is_noisy(problem, base, chosen) && !is_shaped(problem, chosen);
    diagnosis.sure_findings().next().is_none()
        || diagnosis.left > MAX_LEFT
        || leaves_noise
        || !chosen.fit.model.terms.iter().all(|t| is_credible(problem, t))
}

/// The final set of effects of a search, or the given set.
fn chosen(problem: &Problem, effects: &[usize], seeds: &[JointModel]) -> (Search, Candidate) {
    if effects.is_empty() {
        let all = problem.sought_effects();
        let found = searched_sets(
            problem,
            &Breadth::default(),
            &Scope { effects: &all, seeds, least_gain: least_gain(all.len()) },
        );
        let mut chosen = simplified_set(problem, found.accepted_set());
        let accepted = &chosen.fit.model;
        debug!(effects = ?accepted.effect_names(problem.catalogue), score = chosen.score, "set accepted");
        if problem.weighing != Weighing::Innovations {
            chosen = predictive_set(problem, &found, &chosen);
        }
        chosen = credible(problem, chosen);
        (found, chosen)
    } else {
        given_set(problem, effects)
    }
}

/// Whether the effects leave so much of the twin's effort noise, or of the effort itself, that it is not
/// noise.
fn is_noisy(problem: &Problem, base: &Candidate, chosen: &Candidate) -> bool {
    let left = chosen.fit.noise.share_of(&base.fit.noise);
    let loud = chosen.fit.noise.total_deviation() > MAX_LEFT * problem.coverage.effort_rms;
    // By variance; if the noise is a large share of the effort itself, by size.
    left * left > MAX_LEFT || (loud && left > MAX_LEFT)
}

/// Whether the effects have credible shapes beside a remainder. Not if several effects of position correct
/// each other, if a shape may be at the end of its range, or if there is a push in one run, itself a
/// remainder.
fn is_shaped(problem: &Problem, chosen: &Candidate) -> bool {
    let terms = &chosen.fit.model.terms;
    let of = |t: &Term| &problem.catalogue[t.effect];
    if terms.iter().filter(|t| of(t).is_of_position()).count() > 1
        || terms.iter().any(|t| of(t).is_of_one_run())
    {
        return false;
    }
    for (at, term) in chosen.fit.model.placed_terms().filter(|(_, t)| of(t).is_of_position()) {
        for (i, parameter) in of(term).parameters().iter().enumerate().take(term.p.len()) {
            let (low, high) = of(term).parameter_bounds(i, &problem.coverage);
            let half = HALF_WIDTH_95 * chosen.fit.parameter_deviation(at + i);
            let is_at_end = term.p[i] - half <= low || term.p[i] + half >= high;
            if parameter.neutral.is_none() && is_at_end {
                return false;
            }
        }
    }
    true
}

/// Candidates of the same size, weighted relative to the chosen one. Generalizations of a chosen effect and
/// other shapes of the same effect are not counted.
fn rivals(problem: &Problem, found: &Search, chosen: &Candidate) -> Vec<(Vec<usize>, f64)> {
    let own = chosen.effects();
    let own_names = chosen.fit.model.effect_names(problem.catalogue);
    let twin = indistinguishable_set(problem, &own);
    let predicts = problem.weighing != Weighing::Innovations;
    let mut others: Vec<&Candidate> = Vec::new();
    for candidate in &found.by_size[own.len()] {
        let effects = candidate.effects();
        // Scores include a price for parameters, predictions do not: there a more complex set is no rival.
        let is_rival = (!predicts
            || model_richness(&candidate.fit.model) <= model_richness(&chosen.fit.model))
            && effects != own
            && !generalizes(problem.catalogue, &effects, &own)
            && candidate.fit.model.effect_names(problem.catalogue) != own_names
            && twin.as_ref() != Some(&effects);
        if is_rival {
            others.push(candidate);
        }
    }
    let weights = if predicts {
        predicted_weights(problem, chosen, &others)
    } else {
        others.iter().map(|c| (0.5 * (c.score - chosen.score)).exp()).collect()
    };
    let weighed = others.iter().map(|c| c.effects()).zip(weights);
    weighed.chain(twin.clone().map(|effects| (effects, 1.0))).collect()
}

/// Whether a set has an effect with a special case in the set `own`.
pub(super) fn generalizes(catalogue: &Catalogue, effects: &[usize], own: &[usize]) -> bool {
    let own_names: Vec<&str> = own.iter().map(|e| catalogue[*e].name()).collect();
    let mut others = effects.iter().filter(|e| !own.contains(e));
    others.any(|e| catalogue[*e].effect_spec().contains.iter().any(|n| own_names.contains(n)))
}

/// The set with its first indistinguishable effect replaced by the partner: a rival of equal weight.
fn indistinguishable_set(problem: &Problem, own: &[usize]) -> Option<Vec<usize>> {
    let (name, partner) = own.iter().find_map(|e| {
        let effect = &problem.catalogue[*e];
        Some((effect.name(), effect.indistinguishable_partner(&problem.coverage)?))
    })?;
    let index = |name: &str| problem.catalogue.iter().position(|e| e.name() == name);
    let kept = own.iter().copied().filter(|e| Some(*e) != index(name));
    let mut effects: Vec<usize> = kept.chain(index(partner)).collect();
    effects.sort_unstable();
    Some(effects)
}

/// Whether an effect exceeds the errors of the discretization.
fn is_credible(problem: &Problem, term: &Term) -> bool {
    match problem.catalogue[term.effect].place() {
        Place::Delay => term.p[0].abs() > LEAST_DELAY * problem.coverage.interval_s,
        Place::Gain | Place::Scale => (term.p[0] - 1.0).abs() > LEAST_CHANGE,
        Place::Inertia => term.p[0].abs() > LEAST_CHANGE * problem.plant.inertia,
        _ => true,
    }
}

/// Removes effects within the errors of the discretization, if any others are in the set.
fn credible(problem: &Problem, chosen: Candidate) -> Candidate {
    let mut model = chosen.fit.model.clone();
    model.terms.retain(|t| is_credible(problem, t));
    if model.terms.is_empty() || model.terms.len() == chosen.fit.model.terms.len() {
        return chosen;
    }
    refitted_set(problem, &chosen, &model)
}

#[cfg(test)]
#[path = "verdict_tests.rs"]
mod tests;
