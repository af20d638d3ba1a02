//! The report of a joint with doubtful input, without a diagnosis.

use super::{
    assess::{Runs, all_tracks, unproven_report},
    doubt::Doubt,
    report::JointReport,
    verdict::{Diagnosis, Verdict},
};
use crate::{
    fit::problem::Problem,
    model::{
        joint_model::{Catalogue, JointModel},
        plant::Plant,
    },
};

/// The report of a joint without a diagnosis: any effect found might only reflect the input.
#[must_use]
pub fn refused_report(effects: &Catalogue, plant: &Plant, doubt: &Doubt, runs: Runs) -> JointReport {
    let turns = runs.turns;
    let tracks = all_tracks(&runs);
    let coverage = Problem::new(effects, plant, turns, runs.fitted, runs.hold).coverage;
    let nothing = Diagnosis::without_findings(Verdict::Unknown, JointModel::of_plant(plant));
    let diagnosis = Diagnosis { left: 1.0, lacks: vec![doubt.looks_text()], ..nothing };
    let report = unproven_report(doubt.joint.clone(), turns, diagnosis, tracks, coverage);
    JointReport { doubt: Some(doubt.clone()), ..report }
}
