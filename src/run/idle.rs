//! Efforts that were not recorded: drivers fill them with zeros.

use std::collections::BTreeMap;

use super::run_motion::motions;
use common::note::{Note, NoteCode};
use gap::{
    fit::stretch::RunMotion,
    judge::idle::{are_idle_efforts, is_idle_effort},
    record::{command::Told, recording::Recording},
    twin_tree::TwinTree,
};

/// Removes efforts that never change in a run in which their joint was driven. Where each run has commands
/// of the joint, these take their place, with a warning; else gives the reason why the joint cannot be
/// diagnosed, by joint.
pub(super) fn remove_idle_efforts(
    recordings: &mut [(Recording, bool)],
    tree: &TwinTree,
    moving: &[usize],
    told: &Told,
    warnings: &mut Vec<Note>,
) -> BTreeMap<usize, String> {
    let mut refused = BTreeMap::new();
    let is_suspect =
        |j: &usize| recordings.iter().any(|(r, _)| has_constant_effort(r, &tree.joints[*j].name));
    let suspects: Vec<usize> = moving.iter().copied().filter(is_suspect).collect();
    if suspects.is_empty() {
        return refused;
    }
    let runs: Vec<RunMotion> = recordings.iter().map(|(r, _)| motions(r, tree, moving, told)).collect();
    for j in suspects {
        let mut chain = tree.chain_joints(j);
        chain.retain(|k| moving.contains(k));
        chain.push(j);
        let Some(idle) = runs.iter().position(|run| is_idle(tree, run, j, &chain)) else { continue };
        let name = &tree.joints[j].name;
        let what = format!(
            "joint '{name}': its recorded effort never changes in run '{}', though its motion shows that it \
             was driven: it was not measured",
            recordings[idle].0.name
        );
        recordings.iter_mut().for_each(|(run, _)| run.drop_efforts(name));
        if recordings.iter().all(|(run, _)| run.is_commanded(name)) {
            let text = format!("{what}; what it was commanded to is used in its place");
            warnings.push(Note::new(NoteCode::EffortsIdle, text));
        } else {
            let remedy = "record the effort or current that its drive measures, or what it is commanded to";
            refused.insert(j, format!("{what}; {remedy} (--command)"));
        }
    }
    refused
}

/// Whether a run moved a joint without the effort that this takes, alone or with its chain.
fn is_idle(tree: &TwinTree, run: &RunMotion, joint: usize, chain: &[usize]) -> bool {
    match &run[joint] {
        Some(moved) if chain.len() == 1 => is_idle_effort(moved),
        _ => are_idle_efforts(tree, run, chain),
    }
}

/// Whether all efforts of a joint in a run are one number.
fn has_constant_effort(run: &Recording, joint: &str) -> bool {
    let Some(samples) = run.samples(joint) else { return false };
    let mut known = samples.effort.iter().filter(|u| u.is_finite());
    known.next().is_some_and(|first| known.all(|u| u == first))
}
