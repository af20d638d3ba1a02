//! Whether recorded efforts are held between samples, as a simulator applies them, or sampled with the
//! positions, as a drive measures them: the reading under which the logs are more likely, each with the
//! effects that it needs. See docs/method.md 14.15.

use crate::{
    fit::problem::Problem,
    judge::{
        assess::Examined,
        name_weight::least_gain,
        proof::proven_gap,
        search::{fitted_from_seed, fitted_twin},
    },
    model::{effect::Place, joint_model::JointModel, plant::Plant},
    record::{drive::Hold, log::JointLog},
};

/// Gain of score with sampled efforts, before any search: of the twin, or of the effects found with held
/// ones, with and without a delay, which may stand for half an interval. `fitted` are the logs of a joint
/// that was examined with held efforts.
#[must_use]
pub fn promised_gain(held: &Examined, plant: &Plant, fitted: Vec<JointLog>) -> f64 {
    let catalogue = held.problem.catalogue;
    let sampled = Problem::new(catalogue, plant, held.problem.turns, fitted, Hold::Sampled).at_steps();
    let base = fitted_twin(&sampled);
    let found = held.diagnosis.effects_or_nearest();
    let mut seeds = vec![found.clone()];
    let mut prompt = found.clone();
    prompt.terms.retain(|t| catalogue[t.effect].place() != Place::Delay);
    if prompt.terms.len() < found.terms.len() {
        seeds.push(prompt);
    }
    let mut best = base.score;
    for model in seeds.into_iter().filter(|model| !model.terms.is_empty()) {
        let start = JointModel { lag_s: 0.0, ..model };
        best = best.max(fitted_from_seed(&sampled, &base, &start).score);
    }
    best - held.score
}

/// Whether efforts are sampled. They are where held ones would act before they were recorded and sampled ones
/// do not: a cause does not come after its effect. Else a gain of score shows it, where the joints with
/// sampled efforts also predict the held-out runs better: a likelihood alone does not decide between two
/// readings under which the model is not whole.
#[must_use]
pub fn is_sampled(gain: f64, sampled: &[&Examined], held: &[&Examined]) -> bool {
    let is_early = |joints: &[&Examined]| joints.iter().any(|joint| acts_early(joint));
    is_early(held) && !is_early(sampled)
        || gain > least_gain(1) && unseen_log_error(sampled) < unseen_log_error(held)
}

/// Whether the efforts of a joint seem to act before they were recorded, by an interval at most: as those do
/// that are sampled with the positions, and were taken for held.
#[must_use]
pub fn acts_early(joint: &Examined) -> bool {
    let problem = &joint.problem;
    let delay = joint.diagnosis.effects_or_nearest().scalar_of(problem.catalogue, Place::Delay);
    problem.plant.actuator.servo.is_none()
        && delay.is_some_and(|(delay_s, _)| (-problem.coverage.interval_s..0.0).contains(&delay_s))
}

/// Sum over joints of the logarithm of the root mean square residual of the held-out runs under what was
/// found, or what is nearest to it.
fn unseen_log_error(joints: &[&Examined]) -> f64 {
    let mut sum = 0.0;
    for joint in joints.iter().filter(|joint| !joint.held_out.logs.is_empty()) {
        let twin = joint.diagnosis.model.without_effects();
        let (gap, _, _) = proven_gap(&joint.held_out, &twin, joint.diagnosis.effects_or_nearest());
        sum += gap.after.ln();
    }
    sum
}
