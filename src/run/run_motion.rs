//! The motion of joints in a run, as doubts about the input look at it.

use gap::{
    fit::stretch::{Moved, RunMotion},
    record::{command::Told, recording::Recording},
    twin_tree::TwinTree,
};

/// What a run shows of the joints.
pub(super) fn motions(run: &Recording, tree: &TwinTree, joints: &[usize], told: &Told) -> RunMotion {
    let one = |j: usize| {
        let name = &tree.joints[j].name;
        let motion = run.motion(name).ok().filter(|_| joints.contains(&j))?;
        let log = run.joint(name, &[], told, &mut Vec::new()).ok();
        // A servo's efforts are not known before it is.
        Some(Moved { log: log.filter(|l| l.commanded.is_empty()), motion })
    };
    (0..tree.joints.len()).map(one).collect()
}
