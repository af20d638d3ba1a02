//! Reads joint states from bags, and poses and wrenches of links beside them.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use super::{
    bag::Bag,
    joint_commands::{ARRAY, CONTROLLER_STATE, Commands, MAX_JOINTS, Origin, TRAJECTORY},
    mcap_file::RawMessage,
    ros2msg::{
        Header, JointState, PoseStamped, TfMessage, Transform, WrenchStamped, decode,
        joints::{ControllerStateFront, DynamicJointState, Float64MultiArray, JointTrajectory},
    },
};
use capture::CaptureError;
use common::note::{Note, NoteCode};
use gap::record::{
    recording::{JointSamples, Recording},
    tracks::{PoseTrack, Streams, WrenchTrack},
};

/// Message type of most drivers.
pub const JOINT_STATE: &str = "sensor_msgs/msg/JointState";
const WRENCH: &str = "geometry_msgs/msg/WrenchStamped";
const POSE: &str = "geometry_msgs/msg/PoseStamped";
const TF: &str = "tf2_msgs/msg/TFMessage";
/// Type of the messages of a broadcaster of all interfaces.
pub const DYNAMIC: &str = "control_msgs/msg/DynamicJointState";
const TYPES: [&str; 8] = [JOINT_STATE, WRENCH, POSE, TF, DYNAMIC, CONTROLLER_STATE, TRAJECTORY, ARRAY];

/// Whether the messages of a topic are read for a joint log with these streams; `is_cdr` says whether their
/// encoding is `cdr`.
#[must_use]
pub fn is_joint_topic(topic: &str, type_name: &str, is_cdr: bool, streams: &Streams) -> bool {
    let named = |list: &[(String, String)]| list.iter().any(|(t, _)| t == topic);
    if streams.commands.iter().any(|(t, _)| t == topic) {
        return true;
    }
    match type_name {
        // With another encoding they count as lost, whatever they are.
        WRENCH => !is_cdr || named(&streams.wrenches),
        POSE => !is_cdr || named(&streams.poses),
        ARRAY => !is_cdr,
        other => TYPES.contains(&other),
    }
}

#[derive(Default)]
struct Samples {
    stamps: Vec<i64>,
    position: Vec<f64>,
    velocity: Vec<f64>,
    effort: Vec<f64>,
}

impl Samples {
    /// Adds values to the last sample if they have its stamp and are what it lacks: some drivers send
    /// positions and efforts in messages of their own. Returns whether they did.
    fn completes_last(&mut self, stamp: i64, values: [f64; 3]) -> bool {
        let own = [&mut self.position, &mut self.velocity, &mut self.effort];
        if self.stamps.last() != Some(&stamp) {
            return false;
        }
        let mut lasts: Vec<&mut f64> = own.into_iter().filter_map(|v| v.last_mut()).collect();
        if lasts.iter().zip(values).any(|(last, value)| last.is_finite() && value.is_finite()) {
            return false;
        }
        for (last, value) in lasts.iter_mut().zip(values) {
            if value.is_finite() {
                **last = value;
            }
        }
        true
    }
}

/// A track with clock stamps, nanoseconds.
struct Stamped<T> {
    track: T,
    stamps: Vec<i64>,
}

/// Link of a pose message.
struct PosedLink {
    /// Child frame; empty if the message names none.
    child: String,
    link: String,
    /// Whether the user named it.
    asked: bool,
}

/// All data read, in the order of messages.
struct Reader<'a> {
    streams: &'a Streams,
    joints: BTreeMap<String, Samples>,
    /// Controller feedback of joints without a recorded joint state.
    feedback: BTreeMap<String, Samples>,
    commands: Commands,
    /// Pose tracks by topic and child frame; the child is empty for pose messages.
    poses: BTreeMap<(String, String), Stamped<PoseTrack>>,
    wrenches: BTreeMap<String, Stamped<WrenchTrack>>,
    topics: BTreeMap<String, String>,
    /// Topics whose frame changes between messages.
    changing: BTreeSet<String>,
    broken: usize,
    unstamped: usize,
}

/// Adds a sample of (position, velocity, effort) to a joint.
fn add(joints: &mut BTreeMap<String, Samples>, name: &str, stamp: i64, values: [f64; 3]) {
    // Kept joints continue; further ones are left out.
    if joints.len() >= MAX_JOINTS && !joints.contains_key(name) {
        return;
    }
    let samples = joints.entry(name.to_owned()).or_default();
    if samples.completes_last(stamp, values) {
        return;
    }
    samples.stamps.push(stamp);
    samples.position.push(values[0]);
    samples.velocity.push(values[1]);
    samples.effort.push(values[2]);
}

/// Reads all joint states of a bag (rosbag2 folder or `.mcap` file), and the topics of `streams`. Stamps are
/// those of the headers; if these are missing, those of the recorder, with a warning.
///
/// # Errors
/// [`CaptureError`] if the bag cannot be read, contains nothing about joints, or lacks a topic that was
/// named.
pub fn read_joint_log(path: &Path, streams: &Streams) -> Result<Recording, CaptureError> {
    let bag = Bag::open(path)?;
    let mut reader = Reader {
        streams,
        joints: BTreeMap::new(),
        feedback: BTreeMap::new(),
        commands: Commands::default(),
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

impl<'a> Reader<'a> {
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
        // On a used topic this is a loss; other topics are no concern.
        if !is_cdr {
            self.broken += usize::from(TYPES.contains(&message.type_name));
            return;
        }
        let named =
            |list: &[(String, String)]| list.iter().find(|(t, _)| t == topic).map(|(_, link)| link.clone());
        let log_nanos = message.log_time_nanos as i64;
        match message.type_name {
            JOINT_STATE => match decode::<JointState>(message.data) {
                Ok(state) => self.joint_state(topic, &state, log_nanos),
                Err(_) => self.broken += 1,
            },
            DYNAMIC => match decode::<DynamicJointState>(message.data) {
                Ok(state) => self.dynamic_state(&state, log_nanos),
                Err(_) => self.broken += 1,
            },
            CONTROLLER_STATE => match decode::<ControllerStateFront>(message.data) {
                Ok(state) => self.controller_state(&state, log_nanos),
                Err(_) => self.broken += 1,
            },
            TRAJECTORY => match decode::<JointTrajectory>(message.data) {
                Ok(sent) => {
                    // A start time in the header is respected; 0 means at once.
                    let stamp = sent.header.stamp.nanos().filter(|n| *n > 0).unwrap_or(log_nanos);
                    self.commands.trajectory(&sent, stamp, self.joints_of(topic).is_some());
                }
                Err(_) => self.broken += 1,
            },
            ARRAY => {
                let Some(joints) = self.joints_of(topic) else { return };
                match decode::<Float64MultiArray>(message.data) {
                    Ok(array) => self.commands.array(&array, joints, log_nanos),
                    Err(_) => self.broken += 1,
                }
            }
            WRENCH => {
                // Only named topics, as a wrench message does not name its link.
                let Some(link) = named(&self.streams.wrenches) else { return };
                match decode::<WrenchStamped>(message.data) {
                    Ok(wrench) => self.wrench(topic, link, &wrench, log_nanos),
                    Err(_) => self.broken += 1,
                }
            }
            POSE => {
                let Some(link) = named(&self.streams.poses) else { return };
                match decode::<PoseStamped>(message.data) {
                    Ok(m) => {
                        let posed = PosedLink { child: String::new(), link, asked: true };
                        self.pose(topic, posed, &m.header, &m.pose, log_nanos);
                    }
                    Err(_) => self.broken += 1,
                }
            }
            TF => {
                let Ok(message) = decode::<TfMessage>(message.data) else { return };
                for t in &message.transforms {
                    let child = t.child_frame_id.trim_start_matches('/').to_owned();
                    // /tf holds the whole robot; only links of the twin are of use.
                    if self.streams.links.contains(&child) {
                        let posed = PosedLink { child: child.clone(), link: child, asked: false };
                        self.pose(topic, posed, &t.header, &t.transform, log_nanos);
                    }
                }
            }
            _ => {}
        }
    }

    fn stamp(&mut self, header: &Header, log_nanos: i64) -> i64 {
        match header.stamp.nanos() {
            // Drivers without stamps write 0.
            Some(nanos) if nanos > 0 => nanos,
            _ => {
                self.unstamped += 1;
                log_nanos
            }
        }
    }

    /// Joints of the values on a requested topic of commands.
    fn joints_of(&self, topic: &str) -> Option<&'a [String]> {
        self.streams.commands.iter().find(|(t, _)| t == topic).map(|(_, joints)| joints.as_slice())
    }

    fn joint_state(&mut self, topic: &str, state: &JointState, log_nanos: i64) {
        let stamp = self.stamp(&state.header, log_nanos);
        let is_asked = self.joints_of(topic).is_some();
        if is_asked || topic.contains("command") {
            let origin = if is_asked { Origin::Asked } else { Origin::Named };
            self.commands.joint_state(state, stamp, origin);
            return;
        }
        for (i, name) in state.name.iter().enumerate() {
            // JointState: each array is as long as `name`, or empty; some drivers send longer ones.
            let is_known = |values: &[f64]| values.len() >= state.name.len();
            let at = |values: &[f64]| if is_known(values) { values[i] } else { f64::NAN };
            let values = [at(&state.position), at(&state.velocity), at(&state.effort)];
            add(&mut self.joints, name, stamp, values);
        }
    }

    fn dynamic_state(&mut self, state: &DynamicJointState, log_nanos: i64) {
        let stamp = self.stamp(&state.header, log_nanos);
        for (name, interfaces) in state.joint_names.iter().zip(&state.interface_values) {
            let values = ["position", "velocity", "effort"].map(|wanted| {
                let at = interfaces.interface_names.iter().position(|n| n == wanted);
                at.and_then(|i| interfaces.values.get(i)).copied().unwrap_or(f64::NAN)
            });
            add(&mut self.feedback, name, stamp, values);
        }
    }

    fn controller_state(&mut self, state: &ControllerStateFront, log_nanos: i64) {
        let stamp = self.stamp(&state.header, log_nanos);
        self.commands.controller_state(state, stamp);
        for (i, name) in state.joint_names.iter().enumerate() {
            let measured = &state.feedback;
            let values = [&measured.positions, &measured.velocities, &measured.effort]
                .map(|v| v.get(i).copied().unwrap_or(f64::NAN));
            add(&mut self.feedback, name, stamp, values);
        }
    }

    fn wrench(&mut self, topic: &str, link: String, message: &WrenchStamped, log_nanos: i64) {
        let stamp = self.stamp(&message.header, log_nanos);
        let frame = message.header.frame_id.trim_start_matches('/');
        let track =
            WrenchTrack { topic: topic.to_owned(), frame: frame.to_owned(), link, ..WrenchTrack::default() };
        let own = self.wrenches.entry(topic.to_owned()).or_insert(Stamped { track, stamps: Vec::new() });
        let [force, moment] =
            [&message.force, &message.torque].map(|v| nalgebra::Vector3::new(v.x, v.y, v.z));
        if own.track.frame != frame {
            self.changing.insert(topic.to_owned());
        } else if !force.iter().chain(moment.iter()).all(|x| x.is_finite()) {
            self.broken += 1;
        } else if own.stamps.last().is_none_or(|last| stamp > *last) {
            // Stamps of a track rise; repeated and late messages are left out.
            own.stamps.push(stamp);
            own.track.force.push(force);
            own.track.moment.push(moment);
        }
    }

    fn pose(&mut self, topic: &str, posed: PosedLink, header: &Header, pose: &Transform, log_nanos: i64) {
        let stamp = self.stamp(header, log_nanos);
        let frame = header.frame_id.trim_start_matches('/');
        let track = PoseTrack {
            topic: topic.to_owned(),
            frame: frame.to_owned(),
            link: posed.link,
            asked: posed.asked,
            ..PoseTrack::default()
        };
        let own = self
            .poses
            .entry((topic.to_owned(), posed.child))
            .or_insert(Stamped { track, stamps: Vec::new() });
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

    /// Refuses a bag without joints or without a named topic.
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
        let commands =
            self.streams.commands.iter().map(|(t, _)| (t, "commands of joints", self.topics.contains_key(t)));
        for (topic, kind, there) in wrenches.chain(poses).chain(commands) {
            if !there {
                return refused(format!("it holds no usable {kind} on '{topic}'; its topics are: {seen}"));
            }
        }
        // Transforms of other frames beside those of the twin do not matter.
        let named =
            |t: &&String| self.streams.wrenches.iter().chain(&self.streams.poses).any(|(n, _)| n == *t);
        if let Some(topic) = self.changing.iter().find(named) {
            return refused(format!(
                "the frame of '{topic}' changes from message to message; record one frame on a topic"
            ));
        }
        if self.joints.is_empty() && self.feedback.is_empty() && self.poses.is_empty() {
            if self.topics.values().any(|kind| kind == JOINT_STATE) {
                return refused(format!(
                    "its {JOINT_STATE} name no joints: record them with `name` filled in"
                ));
            }
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
        // Joint states take precedence; controllers may know of further joints.
        let mut joints = self.feedback;
        joints.extend(self.joints);
        let starts = joints.values().filter_map(|s| s.stamps.iter().min().copied());
        let starts = starts.chain(self.poses.values().filter_map(|s| s.stamps.first().copied()));
        let first = starts.chain(self.commands.first()).min().unwrap_or(0);
        let seconds = |stamps: &[i64]| stamps.iter().map(|n| (n - first) as f64 * 1e-9).collect::<Vec<f64>>();
        let mut joints: Vec<JointSamples> = joints
            .into_iter()
            .map(|(name, s)| JointSamples {
                name,
                time_s: seconds(&s.stamps),
                position: s.position,
                effort: s.effort,
                velocity: s.velocity,
            })
            .collect();
        let added = joints.iter_mut().filter_map(|j| j.integrate().then(|| j.name.clone()));
        let added: Vec<String> = added.collect();
        if !added.is_empty() {
            warnings.push(Note::new(
                NoteCode::PositionsFromVelocities,
                format!(
                    "run '{name}': positions of {} are added up from velocities, from 0 on",
                    added.join(", ")
                ),
            ));
        }
        let poses = self.poses.into_values().map(|s| PoseTrack { time_s: seconds(&s.stamps), ..s.track });
        let wrenches =
            self.wrenches.into_values().map(|s| WrenchTrack { time_s: seconds(&s.stamps), ..s.track });
        let mut recording = Recording {
            name,
            joints,
            commands: self.commands.since(first),
            poses: poses.collect(),
            wrenches: wrenches.collect(),
            warnings,
        };
        recording.rename_joints(&self.streams.joints);
        recording
    }
}

/// The last part of a path, without the ending of a file.
fn run_name(path: &Path) -> String {
    let name = if path.is_dir() { path.file_name() } else { path.file_stem() };
    name.map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned())
}
