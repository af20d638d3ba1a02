//! A joint with doubtful input: a report without a diagnosis.

use super::{
    assess::{Runs, tracks, unproven},
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

/// The report of a joint without a diagnosis: any effect would be one of the input.
#[must_use]
pub fn refused(effects: &Catalogue, plant: &Plant, doubt: &Doubt, runs: Runs) -> JointReport {
    let turns = runs.turns;
    let tracks = tracks(&runs);
    let coverage = Problem::new(effects, plant, turns, runs.fitted, runs.hold).coverage;
    let nothing = Diagnosis::without_findings(Verdict::Unknown, JointModel::of(plant));
    let diagnosis = Diagnosis { left: 1.0, lacks: vec![doubt.looks()], ..nothing };
    let report = unproven(doubt.joint.clone(), turns, diagnosis, tracks, coverage);
    JointReport { doubt: Some(doubt.clone()), ..report }
}
