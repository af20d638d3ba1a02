//! One joint from its logs to its report: diagnosis on the fitted runs, proof on the held-out ones.

use rand_core::Rng;

use super::{
    drive::Hold,
    joint_model::{Catalogue, JointModel},
    log::JointLog,
    plant::Plant,
    problem::Problem,
    proof::prove,
    report::JointReport,
    verdict::{Verdict, diagnose},
};

/// Logs of one joint, split.
#[derive(Clone, Debug)]
pub struct Runs {
    /// Logs that are fitted.
    pub fitted: Vec<JointLog>,
    /// Logs that only the proof reads.
    pub held_out: Vec<JointLog>,
    /// The joint turns.
    pub turns: bool,
    /// How the effort runs between samples.
    pub hold: Hold,
}

/// Diagnoses a joint and proves the result.
#[must_use]
pub fn assess(effects: &Catalogue, plant: &Plant, name: &str, runs: Runs, rng: &mut impl Rng) -> JointReport {
    let turns = runs.turns;
    let problem = Problem::new(effects, plant, turns, runs.fitted, runs.hold);
    let mut diagnosis = diagnose(&problem, rng);
    let mut report = |diagnosis, proof: Option<_>| {
        let (gap, series) = proof.unzip();
        JointReport { joint: name.to_owned(), turns, diagnosis, gap, series: series.unwrap_or_default() }
    };
    if diagnosis.verdict == Verdict::Insufficient || runs.held_out.is_empty() {
        return report(diagnosis, None);
    }
    let held_out = Problem::held_out(&problem, runs.held_out);
    let twin = JointModel::of(plant);
    // A push belongs to the run that it happened in.
    let mut updated = diagnosis.model.clone();
    updated.terms.retain(|t| effects[t.effect].name() != "disturbance");
    let mut proof = prove(&held_out, &twin, &updated);
    if !updated.terms.is_empty() && proof.0.after > proof.0.before {
        // A name that makes held-out runs worse is no name.
        diagnosis.verdict = Verdict::Unknown;
        diagnosis.findings.clear();
        diagnosis.model = twin.clone();
        proof = prove(&held_out, &twin, &twin);
    }
    report(diagnosis, Some(proof))
}
