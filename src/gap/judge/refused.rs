//! A joint whose input is not what it is taken for: a report without a diagnosis.

use super::{
    assess::{Runs, tracks},
    doubt::Doubt,
    report::JointReport,
    verdict::{Diagnosis, Verdict},
};
use crate::gap::{
    fit::{noise::EffortNoise, problem::Problem},
    model::{
        joint_model::{Catalogue, JointModel},
        plant::Plant,
    },
};

/// The report of a joint that is not diagnosed: any effect would be one of the input.
#[must_use]
pub fn refused(effects: &Catalogue, plant: &Plant, doubt: &Doubt, runs: Runs) -> JointReport {
    let (turns, tracks) = (runs.turns, tracks(&runs));
    let coverage = Problem::new(effects, plant, turns, runs.fitted, runs.hold).coverage;
    let diagnosis = Diagnosis {
        verdict: Verdict::Unknown,
        findings: Vec::new(),
        before: Vec::new(),
        model: JointModel::of(plant),
        left: 1.0,
        lacks: vec![doubt.looks()],
        noise: EffortNoise::default(),
        actuator: Vec::new(),
        nearest: None,
        spread: None,
    };
    JointReport {
        joint: doubt.joint.clone(),
        turns,
        diagnosis,
        gap: None,
        series: Vec::new(),
        laws: Vec::new(),
        tracks,
        coverage,
        in_format: Vec::new(),
        replay: Vec::new(),
        nearest: None,
        off_axis: None,
        doubt: Some(doubt.clone()),
    }
}
