//! Recordings in the forms in which cameras and robots write them: a shipped recording is written anew in
//! each form, and the poses and depth that the program reads of it are those of the plain one.

#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

mod common;
#[path = "common/opened.rs"]
mod opened;

use std::path::{Path, PathBuf};

use capture::{Capture, CaptureConfig, UseColorDepth};
use common::BagWriter;
use geometry::Pose;
use io::{
    Recording,
    ros2msg::{
        CameraInfo, CompressedImage, Header, Image, PoseStamped, TfMessage, Time, Transform,
        TransformStamped, decode,
    },
};
use mcap::Message;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use tempfile::TempDir;

/// A message with its topic, type and time of recording.
#[derive(Clone)]
struct Recorded {
    topic: String,
    type_name: String,
    log_nanos: i64,
    message: Content,
}

#[derive(Clone)]
#[allow(clippy::large_enum_variant, reason = "a message a test")]
enum Content {
    Image(Image),
    Compressed(CompressedImage),
    Info(CameraInfo),
    Tf(TfMessage),
    Pose(PoseStamped),
    Transform(TransformStamped),
}

impl Content {
    /// The headers of a message.
    fn headers(&mut self) -> Vec<&mut Header> {
        match self {
            Self::Image(m) => vec![&mut m.header],
            Self::Compressed(m) => vec![&mut m.header],
            Self::Info(m) => vec![&mut m.header],
            Self::Tf(m) => m.transforms.iter_mut().map(|t| &mut t.header).collect(),
            Self::Pose(m) => vec![&mut m.header],
            Self::Transform(m) => vec![&mut m.header],
        }
    }
}

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("bags").join(name)
}

fn recorded(message: &Message<'_>) -> Recorded {
    let type_name = message.channel.schema.as_ref().unwrap().name.clone();
    let content = match type_name.as_str() {
        "sensor_msgs/msg/Image" => Content::Image(decode(&message.data).unwrap()),
        "sensor_msgs/msg/CompressedImage" => Content::Compressed(decode(&message.data).unwrap()),
        "sensor_msgs/msg/CameraInfo" => Content::Info(decode(&message.data).unwrap()),
        "tf2_msgs/msg/TFMessage" => Content::Tf(decode(&message.data).unwrap()),
        other => panic!("{other}"),
    };
    let log_nanos = message.log_time as i64;
    Recorded { topic: message.channel.topic.clone(), type_name, log_nanos, message: content }
}

/// A shipped recording without masks, each state changed.
fn changed(name: &str, change: impl Fn(usize, Vec<Recorded>) -> Vec<Recorded>) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for state in 0..2 {
        let from = shipped(name).join(format!("state{state}/state{state}.mcap"));
        let data = std::fs::read(from).unwrap();
        let messages = mcap::MessageStream::new(&data).unwrap().map(|m| recorded(&m.unwrap()));
        let plain: Vec<Recorded> = messages.filter(|m| m.topic != "/object_mask").collect();
        let mut writer = BagWriter::create(&folder.path().join(format!("state{state}.mcap")), None, 1 << 20);
        for m in change(state, plain) {
            match &m.message {
                Content::Image(c) => writer.message(&m.topic, &m.type_name, m.log_nanos, c),
                Content::Compressed(c) => writer.message(&m.topic, &m.type_name, m.log_nanos, c),
                Content::Info(c) => writer.message(&m.topic, &m.type_name, m.log_nanos, c),
                Content::Tf(c) => writer.message(&m.topic, &m.type_name, m.log_nanos, c),
                Content::Pose(c) => writer.message(&m.topic, &m.type_name, m.log_nanos, c),
                Content::Transform(c) => writer.message(&m.topic, &m.type_name, m.log_nanos, c),
            }
        }
        writer.finish();
    }
    folder
}

fn each(messages: Vec<Recorded>, mut change: impl FnMut(&mut Recorded)) -> Vec<Recorded> {
    let mut changed = messages;
    changed.iter_mut().for_each(&mut change);
    changed
}

fn without(messages: Vec<Recorded>, topic: &str) -> Vec<Recorded> {
    messages.into_iter().filter(|m| m.topic != topic).collect()
}

fn is_tf(message: &Recorded) -> bool {
    message.topic.starts_with("/tf")
}

fn stamps(message: &mut Recorded, change: impl Fn(i64) -> i64) {
    for header in message.message.headers() {
        header.stamp = Time::from_nanos(change(header.stamp.nanos().unwrap()));
    }
}

/// The recordings of a folder, opened as a run does.
fn opened_states(folder: &Path) -> Vec<Recording> {
    let paths = [0, 1].map(|s| folder.join(format!("state{s}.mcap")));
    let config = CaptureConfig::default();
    Recording::open_states(&paths, &config, &::common::stop::Stop::never()).unwrap()
}

fn poses(recordings: &[Recording]) -> Vec<Vec<Pose>> {
    let of_views = |r: &Recording| r.views.views.iter().map(|v| v.world_from_camera.unwrap()).collect();
    recordings.iter().map(of_views).collect()
}

/// Largest distance, meters, and angle, radians, between motions since the first view.
fn worst(found: &[Vec<Pose>], truth: &[Vec<Pose>]) -> [f64; 2] {
    let mut worst = [0.0f64; 2];
    for (found, truth) in found.iter().zip(truth) {
        assert_eq!(found.len(), truth.len());
        for (a, b) in found.iter().zip(truth) {
            let off = (found[0].inverse() * a).inverse() * (truth[0].inverse() * b);
            worst = [worst[0].max(off.translation.vector.norm()), worst[1].max(off.rotation.angle())];
        }
    }
    worst
}

fn texts(recordings: &[Recording]) -> String {
    let notes = recordings.iter().flat_map(|r| r.views.warnings.iter().chain(&r.views.notes));
    notes.map(|n| format!("{:?}: {}\n", n.code, n.text)).collect()
}

/// Poses of the optical frame in the world, in place of /tf.
fn as_topic(
    messages: Vec<Recorded>,
    optical_from_link: &Pose,
    content: impl Fn(Header, Transform) -> (String, Content),
) -> Vec<Recorded> {
    let mut changed = Vec::new();
    for m in messages {
        let Content::Tf(tf) = &m.message else {
            changed.push(m);
            continue;
        };
        if m.topic == "/tf_static" {
            continue;
        }
        let t = &tf.transforms[0];
        let pose = t.transform.checked().unwrap() * optical_from_link;
        let (type_name, message) = content(t.header.clone(), Transform::from_pose(&pose));
        changed.push(Recorded { topic: "/pose".into(), type_name, log_nanos: m.log_nanos, message });
    }
    changed
}

fn link_from_optical(messages: &[Recorded]) -> Pose {
    let of_static = messages.iter().find(|m| m.topic == "/tf_static").unwrap();
    let Content::Tf(tf) = &of_static.message else { panic!("no tf") };
    tf.transforms[0].transform.checked().unwrap()
}

#[test]
fn stamps_of_zero_and_of_other_clocks_give_the_poses_of_the_plain_recording() {
    let plain = changed("drawer", |_, m| m);
    let truth = poses(&opened_states(plain.path()));
    let second = 1_000_000_000;
    let zero = |m: &mut Recorded| stamps(m, |_| 0);
    let forms: [(&str, Box<dyn Fn(&mut Recorded)>); 4] = [
        (
            "StampsMissing",
            Box::new(move |m| {
                if !is_tf(m) {
                    zero(m)
                }
            }),
        ),
        ("StampsMissing", Box::new(zero)),
        (
            "ClocksDiffer",
            Box::new(move |m| {
                if !is_tf(m) {
                    stamps(m, |t| t - 111 * second)
                }
            }),
        ),
        (
            "ClocksDiffer",
            Box::new(move |m| {
                if m.topic.contains("depth") {
                    stamps(m, |t| t + 5 * second)
                }
            }),
        ),
    ];
    for (code, change) in &forms {
        let folder = changed("drawer", |_, messages| each(messages, change));
        let found = opened_states(folder.path());
        // Times of recording are up to some milliseconds late.
        let [far_m, turned_rad] = worst(&poses(&found), &truth);
        assert!(far_m < 0.01 && turned_rad < 0.01, "{code}: {far_m} {turned_rad}");
        assert!(texts(&found).contains(code), "{}", texts(&found));
    }
}

#[test]
fn poses_on_topics_of_other_types_and_of_other_states_are_the_plain_ones() {
    let plain = changed("laptop", |_, m| m);
    let truth = poses(&opened_states(plain.path()));
    let named = |header: Header, transform: Transform| {
        let sent =
            TransformStamped { header, child_frame_id: "camera_color_optical_frame".into(), transform };
        ("geometry_msgs/msg/TransformStamped".to_owned(), Content::Transform(sent))
    };
    let by_topic = changed("laptop", |_, m| {
        let mounted = link_from_optical(&m);
        as_topic(m, &mounted, named)
    });
    let found = opened_states(by_topic.path());
    assert!(worst(&poses(&found), &truth)[0] < 0.003, "{}", texts(&found));
    let one_static = changed("laptop", |state, m| if state == 1 { without(m, "/tf_static") } else { m });
    let found = opened_states(one_static.path());
    assert!(worst(&poses(&found), &truth)[0] < 1e-9 && texts(&found).contains("TransformsShared"));
    let seen = io::inspect(one_static.path()).unwrap().to_text();
    assert!(seen.contains("usable: yes") && !seen.contains("none recorded"), "{seen}");
}

#[test]
fn poses_of_the_body_are_turned() {
    let plain = changed("laptop", |_, m| m);
    let truth = poses(&opened_states(plain.path()));
    let stamped = |header: Header, pose: Transform| {
        ("geometry_msgs/msg/PoseStamped".to_owned(), Content::Pose(PoseStamped { header, pose }))
    };
    // As the ZED gives them: of the body, without /tf_static.
    let body = changed("laptop", |_, m| as_topic(m, &Pose::identity(), stamped));
    let found = opened_states(body.path());
    assert!(texts(&found).contains("PosesTurned"), "{}", texts(&found));
    let [far_m, turned_rad] = worst(&poses(&found), &truth);
    assert!(far_m < 0.012 && turned_rad < 1e-3, "{far_m} {turned_rad}");
    // A state that lost /tf_static as well: the frame that moves is the body.
    let lost = changed("laptop", |_, m| without(m, "/tf_static"));
    assert!(texts(&opened_states(lost.path())).contains("PosesTurned"));
}

#[test]
fn a_camera_that_stands_still_has_the_pose_of_its_static_transform() {
    let still = changed("laptop", |_, messages| {
        let mounted = link_from_optical(&messages);
        let first_tf = messages.iter().find(|m| m.topic == "/tf").unwrap();
        let Content::Tf(tf) = &first_tf.message else { panic!("no tf") };
        let world_from_optical = tf.transforms[0].transform.checked().unwrap() * mounted;
        let (mut color, mut depth) = (None, None);
        let mut changed = Vec::new();
        for mut m in without(messages, "/tf") {
            if let Content::Tf(tf) = &mut m.message {
                tf.transforms[0].header.frame_id = "world".into();
                tf.transforms[0].child_frame_id = "camera_color_optical_frame".into();
                tf.transforms[0].transform = Transform::from_pose(&world_from_optical);
            }
            // The first picture all the time.
            if let Content::Compressed(c) = &mut m.message {
                let first = if m.topic.contains("depth") { &mut depth } else { &mut color };
                c.data = first.get_or_insert_with(|| c.data.clone()).clone();
            }
            changed.push(m);
        }
        changed
    });
    let found = opened_states(still.path());
    assert!(
        texts(&found).contains("CameraStands") && found[0].views.world_frame == "world",
        "{}",
        texts(&found)
    );
    // The same of a camera that is carried about: what a driver alone records.
    let carried = changed("laptop", |_, m| without(m, "/tf"));
    let found = opened_states(carried.path());
    assert!(found.iter().all(|r| r.views.are_untracked()) && !texts(&found).contains("PosesUnused"));
}

/// A world with y up, as motion capture has it, is turned; everything is in its place then.
#[test]
fn a_world_with_y_up_is_turned_upright() {
    let y_up = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0);
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(y_up));
    let folder = changed("drawer", |_, m| {
        each(m, |m| {
            if let Content::Tf(tf) = &mut m.message
                && m.topic == "/tf"
            {
                let pose = turn * tf.transforms[0].transform.checked().unwrap();
                tf.transforms[0].transform = Transform::from_pose(&pose);
            }
        })
    });
    let config =
        CaptureConfig { denoise: false, color_depth: UseColorDepth::Never, ..CaptureConfig::default() };
    let found: Capture = opened::open(&[folder.path().to_owned()], &config, 0).unwrap();
    assert!(
        found.warnings.iter().any(|w| w.code == ::common::note::NoteCode::WorldTurned),
        "{:?}",
        found.warnings
    );
    let up =
        found.states[0].iter().map(|f| f.world_from_camera.rotation * -Vector3::y()).sum::<Vector3<f64>>();
    assert!(up.z > 0.5 * up.norm(), "{up}");
}
