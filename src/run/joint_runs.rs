//! The runs of one joint of a twin: its logs, in a chain with the motion of the others, and its actuator.

use super::DiagnoseRequest;
use common::note::Note;
use gap::{
    fit::actuation::actuated_plant,
    model::plant::Plant,
    record::{
        chain::{carried_by_stamp, joint_motions},
        command::Told,
        drive::Hold,
        log::JointLog,
        recording::{Recording, RecordingError},
    },
    twin_tree::TwinTree,
};

/// Runs of one joint, split.
pub(super) struct Split {
    pub fitted: Vec<JointLog>,
    pub held_out: Vec<JointLog>,
}

impl Split {
    /// Whether the joint follows commands in any run.
    pub(super) fn is_commanded(&self) -> bool {
        self.fitted.iter().chain(&self.held_out).any(|log| !log.commanded.is_empty())
    }
}

/// Why the runs say nothing about a joint.
#[derive(Debug, thiserror::Error)]
enum SplitError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error("joint '{joint}': {source}")]
    Chain { joint: String, source: RecordingError },
}

/// Up to this many runs, each gives its last third to the proof: a fit to a single whole run would know only
/// its conditions.
pub(super) const MOST_DIVIDED: usize = 2;

/// Indices of the independently moving joints of a twin.
pub(super) fn moving_joints(tree: &TwinTree) -> Vec<usize> {
    let joints = tree.joints.iter().enumerate();
    joints.filter(|(_, joint)| joint.is_independent()).map(|(j, _)| j).collect()
}

/// A joint's plant with its actuator, and its runs, with efforts read as `hold` says.
pub(super) fn plant_and_runs(
    request: &DiagnoseRequest,
    recordings: &[(Recording, bool)],
    tree: &TwinTree,
    joint: usize,
    names: &[String],
    hold: Hold,
    warnings: &mut Vec<Note>,
) -> Result<(Plant, Split), String> {
    let plant = Plant::of_joint(tree, joint).map_err(|e| e.to_string())?;
    let split = split(recordings, tree, joint, hold, &request.told, names, warnings);
    let mut split = split.map_err(|e| e.to_string())?;
    let fitted = &mut split.fitted;
    let held_out = &mut split.held_out;
    let plant = actuated_plant(&tree.joints[joint].name, &plant, fitted, held_out, &request.told)
        .map_err(|e| e.to_string())?;
    Ok((plant, split))
}

/// Splits the logs of one joint into fit and proof. With up to two runs, each gives its last third to the
/// proof.
fn split(
    recordings: &[(Recording, bool)],
    tree: &TwinTree,
    joint: usize,
    hold: Hold,
    told: &Told,
    names: &[String],
    warnings: &mut Vec<Note>,
) -> Result<Split, SplitError> {
    let name = &tree.joints[joint].name;
    let chain = tree.chain_joints(joint);
    let moving: Vec<usize> = (0..tree.joints.len()).filter(|j| *j == joint || chain.contains(j)).collect();
    let mut fitted = Vec::new();
    let mut held_out = Vec::new();
    for (recording, held) in recordings {
        let mut log = recording.joint(name, names, told, warnings)?;
        // The other joints of a chain load this joint by their recorded motion.
        if !chain.is_empty() {
            let mut all = joint_motions(tree, &moving, recording, hold, told)
                .map_err(|source| SplitError::Chain { joint: name.clone(), source })?;
            all.retain(|(j, _)| chain.contains(j));
            log.carried = carried_by_stamp(tree, joint, &all, &log.time_s);
        }
        if *held { held_out.push(log) } else { fitted.push(log) }
    }
    if held_out.is_empty() && fitted.len() <= MOST_DIVIDED {
        for log in std::mem::take(&mut fitted) {
            // By time, not at random: neighboring samples are alike, and the proof would see fitted data.
            let cut = log.time_s.len() * 2 / 3;
            fitted.push(log.part_between(0, cut));
            held_out.push(log.part_between(cut, log.time_s.len()));
        }
    }
    Ok(Split { fitted, held_out })
}
