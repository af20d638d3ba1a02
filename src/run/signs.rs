//! Efforts without a sign: commands give them one, or they are not used.

use std::collections::BTreeMap;

use super::run_motion::motions;
use common::note::{Note, NoteCode};
use gap::{
    fit::stretch::RunMotion,
    judge::{
        doubt::{JointScene, Scene},
        unsigned::{is_magnitude, is_never_negative, sign_by_command},
    },
    record::{command::Told, drive::Hold, recording::Recording},
    twin_tree::TwinTree,
};

/// Gives efforts recorded as magnitudes their sign if all runs have commands of the joint, and removes them
/// if not; returns the reasons by joint. The flag of a run says whether only the proof uses it.
pub(super) fn settle_signs(
    recordings: &mut [(Recording, bool)],
    tree: &TwinTree,
    moving: &[usize],
    hold: Option<Hold>,
    told: &Told,
    warnings: &mut Vec<Note>,
) -> BTreeMap<usize, String> {
    let mut refused = BTreeMap::new();
    let suspects: Vec<usize> = moving
        .iter()
        .copied()
        .filter(|&j| is_never_negative(recordings.iter().map(|(r, _)| r), &tree.joints[j].name))
        .collect();
    if suspects.is_empty() {
        return refused;
    }
    let fitted = recordings.iter().filter(|(_, held)| !held);
    let runs: Vec<RunMotion> = fitted.map(|(r, _)| motions(r, tree, moving, told)).collect();
    let scene = Scene { tree, runs: &runs, joints: moving, hold };
    for j in suspects {
        let name = &tree.joints[j].name;
        if !is_magnitude(&JointScene::of_joint(&scene, j)) {
            continue;
        }
        let what = format!(
            "joint '{name}': its efforts are never negative, though its motion shows that it was driven both \
             ways"
        );
        if recordings.iter().all(|(r, _)| r.is_commanded(name)) {
            recordings.iter_mut().for_each(|(r, _)| _ = sign_by_command(r, name));
            let text = format!("{what}: their sign is that of the command less the position");
            warnings.push(Note::new(NoteCode::EffortsWithoutSign, text));
        } else {
            recordings.iter_mut().for_each(|(run, _)| run.drop_efforts(name));
            let why = format!(
                "{what}: a magnitude without a sign is no effort; record the effort or current with its \
                 sign, or what the joint is commanded to (--command)"
            );
            refused.insert(j, why);
        }
    }
    refused
}
