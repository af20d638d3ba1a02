//! Joint states from bags, and poses and wrenches of links beside them.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use super::{
    bag::Bag,
    mcap_file::RawMessage,
    ros2msg::{Header, JointState, PoseStamped, TfMessage, Transform, WrenchStamped, decode},
};
use crate::{
    capture::CaptureError,
    gap::record::{
        recording::{JointSamples, Recording},
        tracks::{PoseTrack, Streams, WrenchTrack},
    },
    note::{Note, NoteCode},
};

/// Types of the messages that are read.
const JOINT_STATE: &str = "sensor_msgs/msg/JointState";
const WRENCH: &str = "geometry_msgs/msg/WrenchStamped";
const POSE: &str = "geometry_msgs/msg/PoseStamped";
const TF: &str = "tf2_msgs/msg/TFMessage";
/// Most joints of one recording.
const MAX_JOINTS: usize = 256;

#[derive(Default)]
struct Samples {
    stamps: Vec<i64>,
    position: Vec<f64>,
    effort: Vec<f64>,
}

/// A track whose stamps are still those of the clock.
struct Stamped<T> {
    track: T,
    stamps: Vec<i64>,
}

/// Everything that is read, as it comes.
struct Reader<'a> {
    streams: &'a Streams,
    joints: BTreeMap<String, Samples>,
    /// By topic and child frame; an empty child for poses.
    poses: BTreeMap<(String, String), Stamped<PoseTrack>>,
    wrenches: BTreeMap<String, Stamped<WrenchTrack>>,
    topics: BTreeMap<String, String>,
    /// Topics whose frame changes from message to message.
    changing: BTreeSet<String>,
    broken: usize,
    unstamped: usize,
}

/// Reads all joint states of a bag (rosbag2 folder or `.mcap` file), and what `streams` names. Stamps are
/// those of the headers; where these are missing, those of the recorder, with a warning.
///
/// # Errors
/// [`CaptureError`] where the bag cannot be read, holds nothing about joints, or lacks a topic that was
/// named.
pub fn read_joint_log(path: &Path, streams: &Streams) -> Result<Recording, CaptureError> {
    let bag = Bag::open(path)?;
    let mut reader = Reader {
        streams,
        joints: BTreeMap::new(),
        poses: BTreeMap::new(),
        wrenches: BTreeMap::new(),
        topics: BTreeMap::new(),
        changing: BTreeSet::new(),
        broken: 0,
        unstamped: 0,
    };
    let reports = bag.read(&mut |message| {
        reader.message(message);
        Ok(())
    })?;
    reader.check(path)?;
    let mut warnings = bag.warnings.clone();
    warnings.extend(
        reports.iter().filter_map(|(file, report): &(PathBuf, _)| report.damage(&file.display().to_string())),
    );
    Ok(reader.recording(run_name(path), warnings))
}

impl Reader<'_> {
    fn message(&mut self, message: &RawMessage) {
        let topic = message.topic;
        let is_cdr = message.message_encoding == "cdr";
        self.topics.entry(topic.to_owned()).or_insert_with(|| {
            let foreign = if is_cdr {
                String::new()
            } else {
                format!(", encoded as `{}`, not cdr", message.message_encoding)
            };
            format!("{}{foreign}", message.type_name)
        });
        // Of what would be used, this is a loss; other topics are no concern.
        if !is_cdr {
            self.broken += usize::from([JOINT_STATE, WRENCH, POSE, TF].contains(&message.type_name));
            return;
        }
        let named =
            |list: &[(String, String)]| list.iter().find(|(t, _)| t == topic).map(|(_, link)| link.clone());
        let log_nanos = message.log_time_nanos as i64;
        match message.type_name {
            JOINT_STATE => match decode::<JointState>(message.data) {
                Ok(state) => self.joint_state(&state, log_nanos),
                Err(_) => self.broken += 1,
            },
            WRENCH => {
                // Only topics that were named: a wrench does not say which link it acts on.
                let Some(link) = named(&self.streams.wrenches) else { return };
                match decode::<WrenchStamped>(message.data) {
                    Ok(wrench) => self.wrench(topic, link, &wrench, log_nanos),
                    Err(_) => self.broken += 1,
                }
            }
            POSE => {
                let Some(link) = named(&self.streams.poses) else { return };
                match decode::<PoseStamped>(message.data) {
                    Ok(m) => self.pose(topic, (String::new(), link, true), &m.header, &m.pose, log_nanos),
                    Err(_) => self.broken += 1,
                }
            }
            TF => {
                let Ok(message) = decode::<TfMessage>(message.data) else { return };
                for t in &message.transforms {
                    let child = t.child_frame_id.trim_start_matches('/').to_owned();
                    // /tf holds the whole robot; only links of the twin are of use.
                    if self.streams.links.contains(&child) {
                        self.pose(topic, (child.clone(), child, false), &t.header, &t.transform, log_nanos);
                    }
                }
            }
            _ => {}
        }
    }

    fn stamp(&mut self, header: &Header, log_nanos: i64) -> i64 {
        match header.stamp.nanos() {
            // Drivers that do not stamp leave 0.
            Some(nanos) if nanos > 0 => nanos,
            _ => {
                self.unstamped += 1;
                log_nanos
            }
        }
    }

    fn joint_state(&mut self, state: &JointState, log_nanos: i64) {
        let stamp = self.stamp(&state.header, log_nanos);
        for (i, name) in state.name.iter().enumerate() {
            // Joints that are kept go on; further ones are left out.
            if self.joints.len() >= MAX_JOINTS && !self.joints.contains_key(name) {
                continue;
            }
            let samples = self.joints.entry(name.clone()).or_default();
            // JointState: each array has the length of `name` or is empty.
            let at = |values: &[f64]| if values.len() == state.name.len() { values[i] } else { f64::NAN };
            samples.stamps.push(stamp);
            samples.position.push(at(&state.position));
            samples.effort.push(at(&state.effort));
        }
    }

    fn wrench(&mut self, topic: &str, link: String, message: &WrenchStamped, log_nanos: i64) {
        let stamp = self.stamp(&message.header, log_nanos);
        let frame = message.header.frame_id.trim_start_matches('/');
        let track =
            WrenchTrack { topic: topic.to_owned(), frame: frame.to_owned(), link, ..WrenchTrack::default() };
        let own = self.wrenches.entry(topic.to_owned()).or_insert(Stamped { track, stamps: Vec::new() });
        let vector = |v: &super::ros2msg::Vector3| nalgebra::Vector3::new(v.x, v.y, v.z);
        let (force, moment) = (vector(&message.force), vector(&message.torque));
        if own.track.frame != frame {
            self.changing.insert(topic.to_owned());
        } else if !force.iter().chain(moment.iter()).all(|x| x.is_finite()) {
            self.broken += 1;
        } else if own.stamps.last().is_none_or(|last| stamp > *last) {
            // Stamps of a track rise; a message that was sent again or came late is left out.
            own.stamps.push(stamp);
            own.track.force.push(force);
            own.track.moment.push(moment);
        }
    }

    /// A pose of (child frame, link, whether it was asked for).
    fn pose(
        &mut self,
        topic: &str,
        (child, link, asked): (String, String, bool),
        header: &Header,
        pose: &Transform,
        log_nanos: i64,
    ) {
        let stamp = self.stamp(header, log_nanos);
        let frame = header.frame_id.trim_start_matches('/');
        let track = PoseTrack {
            topic: topic.to_owned(),
            frame: frame.to_owned(),
            link,
            asked,
            ..PoseTrack::default()
        };
        let own =
            self.poses.entry((topic.to_owned(), child)).or_insert(Stamped { track, stamps: Vec::new() });
        let Some(pose) = pose.checked() else {
            self.broken += 1;
            return;
        };
        if own.track.frame != frame {
            self.changing.insert(topic.to_owned());
        } else if own.stamps.last().is_none_or(|last| stamp > *last) {
            own.stamps.push(stamp);
            own.track.pose.push(pose);
        }
    }

    /// Refuses a bag that holds nothing about joints, or lacks what was named.
    fn check(&self, path: &Path) -> Result<(), CaptureError> {
        let refused = |reason: String| Err(CaptureError::NotARecording { path: path.to_owned(), reason });
        let seen: Vec<String> = self.topics.iter().map(|(topic, kind)| format!("{topic} ({kind})")).collect();
        let seen = if seen.is_empty() { "none".to_owned() } else { seen.join(", ") };
        let wrenches = self
            .streams
            .wrenches
            .iter()
            .map(|(t, _)| (t, WRENCH, self.wrenches.get(t).is_some_and(|w| !w.stamps.is_empty())));
        let has_pose =
            |t: &String| self.poses.get(&(t.clone(), String::new())).is_some_and(|p| !p.stamps.is_empty());
        let poses = self.streams.poses.iter().map(|(t, _)| (t, POSE, has_pose(t)));
        for (topic, kind, there) in wrenches.chain(poses) {
            if !there {
                return refused(format!("it holds no usable {kind} on '{topic}'; its topics are: {seen}"));
            }
        }
        // Transforms of other frames beside those of the twin are no concern.
        let named =
            |t: &&String| self.streams.wrenches.iter().chain(&self.streams.poses).any(|(n, _)| n == *t);
        if let Some(topic) = self.changing.iter().find(named) {
            return refused(format!(
                "the frame of '{topic}' changes from message to message; record one frame on a topic"
            ));
        }
        if self.joints.is_empty() && self.poses.is_empty() {
            let what = "nor transforms (/tf) of the twin's links";
            return refused(format!(
                "it holds no {JOINT_STATE}, {what}; its topics are: {seen}; name poses with --pose"
            ));
        }
        Ok(())
    }

    fn recording(self, name: String, mut warnings: Vec<Note>) -> Recording {
        if self.broken > 0 {
            warnings.push(Note::new(
                NoteCode::MessagesUndecodable,
                format!("run '{name}': {} messages could not be decoded or hold no numbers", self.broken),
            ));
        }
        if self.unstamped > 0 {
            warnings.push(Note::new(
                NoteCode::StampsMissing,
                format!(
                    "run '{name}': {} messages have no stamp; the recorder's time is used",
                    self.unstamped
                ),
            ));
        }
        // One zero for all streams, subtracted as integers: an f64 holds seconds since the epoch to 0.2 us.
        let starts = self.joints.values().filter_map(|s| s.stamps.iter().min());
        let starts = starts.chain(self.poses.values().filter_map(|s| s.stamps.first()));
        let first = starts.min().copied().unwrap_or(0);
        let seconds = |stamps: &[i64]| stamps.iter().map(|n| (n - first) as f64 * 1e-9).collect::<Vec<f64>>();
        let joints = self.joints.into_iter().map(|(name, s)| JointSamples {
            name,
            time_s: seconds(&s.stamps),
            position: s.position,
            effort: s.effort,
        });
        let poses = self.poses.into_values().map(|s| PoseTrack { time_s: seconds(&s.stamps), ..s.track });
        let wrenches =
            self.wrenches.into_values().map(|s| WrenchTrack { time_s: seconds(&s.stamps), ..s.track });
        Recording {
            name,
            joints: joints.collect(),
            poses: poses.collect(),
            wrenches: wrenches.collect(),
            warnings,
        }
    }
}

/// The last part of a path, without the ending of a file.
fn run_name(path: &Path) -> String {
    let name = if path.is_dir() { path.file_name() } else { path.file_stem() };
    name.map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned())
}
