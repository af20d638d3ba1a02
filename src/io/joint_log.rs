//! Joint states from bags.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use super::{
    bag::Bag,
    ros2msg::{JointState, decode},
};
use crate::{
    capture::CaptureError,
    gap::recording::{JointSamples, Recording},
};

/// Type of the messages that are read.
const JOINT_STATE: &str = "sensor_msgs/msg/JointState";
/// Most joints of one recording.
const MAX_JOINTS: usize = 256;

#[derive(Default)]
struct Samples {
    stamps: Vec<i64>,
    position: Vec<f64>,
    effort: Vec<f64>,
}

/// Reads all joint states of a bag (rosbag2 folder or `.mcap` file). Stamps are those of the headers; where these are
/// missing, those of the recorder, with a warning.
///
/// # Errors
/// [`CaptureError`] where the bag cannot be read or holds no joint state.
pub fn read_joint_log(path: &Path) -> Result<Recording, CaptureError> {
    let bag = Bag::open(path)?;
    let mut joints: BTreeMap<String, Samples> = BTreeMap::new();
    let (mut broken, mut unstamped, mut others) = (0usize, 0usize, BTreeMap::<String, String>::new());
    let reports = bag.read(&mut |message| {
        if message.type_name != JOINT_STATE {
            others.insert(message.topic.to_owned(), message.type_name.to_owned());
            return Ok(());
        }
        let Ok(state) = decode::<JointState>(message.data) else {
            broken += 1;
            return Ok(());
        };
        let stamp = match state.header.stamp.nanos() {
            Some(nanos) if nanos > 0 => nanos,
            _ => {
                unstamped += 1;
                message.log_time_nanos as i64
            }
        };
        for (i, name) in state.name.iter().enumerate() {
            if joints.len() >= MAX_JOINTS && !joints.contains_key(name) {
                continue;
            }
            let samples = joints.entry(name.clone()).or_default();
            let at = |values: &[f64]| if values.len() == state.name.len() { values[i] } else { f64::NAN };
            samples.stamps.push(stamp);
            samples.position.push(at(&state.position));
            samples.effort.push(at(&state.effort));
        }
        Ok(())
    })?;
    let name = run_name(path);
    if joints.is_empty() {
        let seen = others.iter().map(|(topic, kind)| format!("{topic} ({kind})")).collect::<Vec<_>>().join(", ");
        let reason = format!("it holds no {JOINT_STATE}; its topics are: {}", if seen.is_empty() { "none" } else { &seen });
        return Err(CaptureError::NotARecording { path: path.to_owned(), reason });
    }
    let mut warnings = bag.warnings.clone();
    warnings.extend(reports.iter().filter_map(|(file, report): &(PathBuf, _)| report.damage(&file.display().to_string())));
    if broken > 0 {
        warnings.push(format!("run '{name}': {broken} joint states could not be decoded"));
    }
    if unstamped > 0 {
        warnings.push(format!("run '{name}': {unstamped} joint states have no stamp; the recorder's time is used"));
    }
    let first = joints.values().filter_map(|s| s.stamps.iter().min()).min().copied().unwrap_or(0);
    let samples = joints.into_iter().map(|(name, s)| JointSamples {
        name,
        time_s: s.stamps.iter().map(|n| (n - first) as f64 * 1e-9).collect(),
        position: s.position,
        effort: s.effort,
    });
    Ok(Recording { name, joints: samples.collect(), warnings })
}

/// The last part of a path, without the ending of a file.
fn run_name(path: &Path) -> String {
    let name = if path.is_dir() { path.file_name() } else { path.file_stem() };
    name.map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned())
}
