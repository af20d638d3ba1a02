//! Joints in a bag, and whether `diagnose` can use it.

use std::path::Path;

use super::{
    joint_commands::{CONTROLLER_STATE, TRAJECTORY},
    joint_log::{DYNAMIC, JOINT_STATE, read_joint_log},
};
use gap::record::{
    command::Told,
    recording::{JointSamples, Recording},
    tracks::Streams,
};

/// The joints in a bag.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MotionInspection {
    /// A line for each joint, or the reason why there is none.
    pub joints: Vec<String>,
    /// Whether `diagnose` can use at least one of them.
    pub is_usable: bool,
}

/// Whether messages of a type are about joints.
pub fn is_of_joints(type_name: &str) -> bool {
    [JOINT_STATE, DYNAMIC, CONTROLLER_STATE, TRAJECTORY].contains(&type_name)
}

/// Looks at the joints of a bag.
pub fn inspect_motion(path: &Path) -> MotionInspection {
    match read_joint_log(path, &Streams::default()) {
        Ok(run) => {
            let lines: Vec<(String, bool)> = run.joints.iter().map(|joint| line(&run, joint)).collect();
            let is_usable = lines.iter().any(|(_, usable)| *usable);
            MotionInspection { joints: lines.into_iter().map(|(text, _)| text).collect(), is_usable }
        }
        Err(error) => MotionInspection { joints: vec![error.to_string()], is_usable: false },
    }
}

fn has_finite(values: &[f64]) -> bool {
    values.iter().any(|x| x.is_finite())
}

/// A line on the data of a joint, and whether it is enough.
fn line(run: &Recording, joint: &JointSamples) -> (String, bool) {
    let first = joint.time_s.iter().copied().fold(f64::INFINITY, f64::min);
    let last = joint.time_s.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let n = joint.time_s.len();
    let seconds = (last - first).max(0.0);
    let rate =
        if n > 1 && seconds > 0.0 { format!(", {:.1} Hz", (n - 1) as f64 / seconds) } else { String::new() };
    let command = run.commands.iter().any(|c| c.joint == joint.name);
    let held: Vec<&str> = [
        (has_finite(&joint.position), "positions"),
        (has_finite(&joint.velocity), "velocities"),
        (has_finite(&joint.effort), "efforts"),
        (command, "commands"),
    ]
    .into_iter()
    .filter_map(|(there, what)| there.then_some(what))
    .collect();
    let held = if held.is_empty() { "nothing".to_owned() } else { held.join(", ") };
    // The first question of a diagnosis, too.
    let usable = run.joint(&joint.name, &[], &Told::default(), &mut Vec::new());
    let verdict = match &usable {
        Ok(_) => "usable by diagnose".to_owned(),
        Err(why) => format!("not usable by diagnose: {why}"),
    };
    (format!("{}: {n} samples, {seconds:.1} s{rate}, {held}; {verdict}", joint.name), usable.is_ok())
}
