//! Doubts about a twin and its runs before effects are searched.

use std::collections::BTreeMap;

use super::{run_motion::motions, signs::settle_signs};
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

/// Why joints are not diagnosed because their efforts have no sign, and doubts about the others, by joint.
/// Efforts without a sign take that of their commands. Warnings are added for both.
pub(super) fn input_doubts(
    recordings: &mut [(Recording, bool)],
    tree: &TwinTree,
    moving: &[usize],
    hold: Hold,
    told: &Told,
    warnings: &mut Vec<Note>,
) -> (BTreeMap<usize, String>, BTreeMap<usize, Doubt>) {
    let unsigned = settle_signs(recordings, tree, moving, hold, told, warnings);
    let doubts = doubts_of(recordings, tree, moving, hold, told);
    warnings.extend(doubts.values().map(Doubt::note));
    (unsigned, doubts)
}

/// Doubts about the joints `moving` of a twin, by joint.
fn doubts_of(
    recordings: &[(Recording, bool)],
    tree: &TwinTree,
    moving: &[usize],
    hold: Hold,
    told: &Told,
) -> BTreeMap<usize, Doubt> {
    // If the unit of efforts is unknown, neither their sign nor their size shows anything; the factor is
    // estimated.
    if told.unit == EffortUnit::Unknown {
        return BTreeMap::new();
    }
    // Joints that follow others have no efforts of their own.
    let joints: Vec<usize> = moving
        .iter()
        .copied()
        .filter(|j| tree.chain_joints(*j).iter().all(|k| !tree.joints[*k].is_mimic))
        .collect();
    let fitted = recordings.iter().filter(|(_, held)| !held).map(|(recording, _)| recording);
    let runs: Vec<RunMotion> = fitted.map(|r| motions(r, tree, &joints, told)).collect();
    doubts_of_scene(&Scene { tree, runs: &runs, joints: &joints, hold })
}
