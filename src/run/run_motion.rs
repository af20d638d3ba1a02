//! The motion of joints in a run, for judging doubts about the input.

use gap::{
    fit::stretch::{Moved, RunMotion},
    record::{command::Told, recording::Recording},
    twin_tree::TwinTree,
};

/// The motion in a run of each joint of a twin; `None` for joints not in `joints`.
pub(super) fn motions(run: &Recording, tree: &TwinTree, joints: &[usize], told: &Told) -> RunMotion {
    let asked = (0..tree.joints.len()).map(|j| joints.contains(&j).then(|| &tree.joints[j].name));
    asked.map(|name| joint_motion(run, name?, told)).collect()
}

fn joint_motion(run: &Recording, name: &str, told: &Told) -> Option<Moved> {
    let motion = run.motion(name).ok()?;
    let log = run.joint(name, &[], told, &mut Vec::new()).ok();
    // A servo's efforts are unknown before the servo is.
    Some(Moved { log: log.filter(|l| l.commanded.is_empty()), motion })
}
