//! Doubts about a twin and its runs before effects are searched.

use std::collections::BTreeMap;

use super::{idle::remove_idle_efforts, run_motion::motions, signs::settle_signs};
use common::note::Note;
use gap::{
    fit::stretch::RunMotion,
    judge::doubt::{Doubt, Scene, doubts_of_scene},
    record::{
        command::{EffortUnit, Told},
        drive::Hold,
        recording::Recording,
    },
    twin_tree::TwinTree,
};

/// Why joints are not diagnosed because their efforts were not measured or have no sign, and doubts about the
/// others, by joint.
/// Efforts without a sign take that of their commands. Warnings are added for both.
pub(super) fn input_doubts(
    recordings: &mut [(Recording, bool)],
    tree: &TwinTree,
    moving: &[usize],
    hold: Option<Hold>,
    told: &Told,
    warnings: &mut Vec<Note>,
) -> (BTreeMap<usize, String>, BTreeMap<usize, Doubt>) {
    let mut unusable = remove_idle_efforts(recordings, tree, moving, told, warnings);
    unusable.extend(settle_signs(recordings, tree, moving, hold, told, warnings));
    let doubts = doubts_of(recordings, tree, moving, hold, told);
    warnings.extend(doubts.values().map(Doubt::note));
    (unusable, doubts)
}

/// Doubts about the joints `moving` of a twin, by joint.
fn doubts_of(
    recordings: &[(Recording, bool)],
    tree: &TwinTree,
    moving: &[usize],
    hold: Option<Hold>,
    told: &Told,
) -> BTreeMap<usize, Doubt> {
    // If the unit of efforts is unknown, neither their sign nor their size shows anything; the factor is
    // estimated.
    if told.unit == EffortUnit::Unknown {
        return BTreeMap::new();
    }
    // The efforts of a joint that others follow move these, too.
    let is_alone = |j: &usize| tree.chain_joints(*j).iter().all(|k| !tree.follows(*k, *j));
    let joints: Vec<usize> = moving.iter().copied().filter(is_alone).collect();
    let fitted = recordings.iter().filter(|(_, held)| !held).map(|(recording, _)| recording);
    let runs: Vec<RunMotion> = fitted.map(|r| motions(r, tree, &joints, told)).collect();
    doubts_of_scene(&Scene { tree, runs: &runs, joints: &joints, hold })
}
