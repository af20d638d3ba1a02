//! `artitwin diagnose` on wrenches, poses and transforms in place of joint states: the same diagnosis, and
//! what it refuses.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

mod common;
#[path = "common/door.rs"]
mod door;
#[path = "common/program.rs"]
mod program;

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use common::{BagWriter, START};
use door::{DAMPING, INERTIAL, Sample, door, twin};
use geometry::Pose;
use io::ros2msg::{
    Header, JointState, PoseStamped, TfMessage, Time, Transform, TransformStamped, WrenchStamped,
};
use nalgebra::Vector3;
use program::{Ended, end};
use tempfile::TempDir;

/// Damping that the twin does not know of, N m s/rad.
const HIDDEN: f64 = 0.5;

/// How a run is recorded.
#[derive(Clone, Copy)]
struct Recorded {
    /// Joint states with positions, and with efforts.
    states: Option<bool>,
    /// Wrenches in this frame.
    wrench: Option<&'static str>,
    /// Poses of the handle in the world.
    poses: bool,
    /// Transforms of the door.
    transforms: bool,
    /// By how much the hinge stands off the twin's, meters.
    off_m: f64,
}

const NOTHING: Recorded =
    Recorded { states: None, wrench: None, poses: false, transforms: false, off_m: 0.0 };

fn world_from_door(q: f64, off_m: f64) -> Pose {
    // The part stands where the twin has it at 0, whatever the hinge does.
    let off = Pose::translation(0.0, off_m, 0.0);
    Pose::translation(0.5, 0.0, 0.0) * off * Pose::rotation(Vector3::z() * q) * off.inverse()
}

fn write(folder: &TempDir, run: usize, samples: &[Sample], how: Recorded) -> PathBuf {
    let path = folder.path().join(format!("run_{run}.mcap"));
    let mut bag = BagWriter::create(&path, None, 100_000);
    for s in samples {
        let nanos = START + (s.time_s * 1e9).round() as i64;
        let header = |frame: &str| Header { stamp: Time::from_nanos(nanos), frame_id: frame.to_owned() };
        let (q, u) = (s.position[0], s.effort[0]);
        if let Some(with_effort) = how.states {
            let effort = if with_effort { vec![u] } else { Vec::new() };
            let state = JointState {
                header: header(""),
                name: vec!["door_joint".to_owned()],
                position: vec![q],
                velocity: Vec::new(),
                effort,
            };
            bag.message("/joint_states", "sensor_msgs/msg/JointState", nanos, &state);
        }
        if let Some(frame) = how.wrench {
            // Pushed across the door at the handle, a meter from the hinge, and along it, which turns
            // nothing.
            let along = Vector3::new(3.0, u, 1.0);
            let force =
                if frame == "world" { Pose::rotation(Vector3::z() * q).rotation * along } else { along };
            let message = WrenchStamped {
                header: header(frame),
                force: [force.x, force.y, force.z].into(),
                torque: [0.2, 0.1, 0.0].into(),
            };
            bag.message("/gauge", "geometry_msgs/msg/WrenchStamped", nanos, &message);
        }
        let pose = world_from_door(q, how.off_m);
        if how.poses {
            let handle = Transform::from_pose(&(pose * Pose::translation(1.0, 0.0, 0.0)));
            bag.message(
                "/handle_pose",
                "geometry_msgs/msg/PoseStamped",
                nanos,
                &PoseStamped { header: header("world"), pose: handle },
            );
        }
        if how.transforms {
            let one = |child: &str, pose: &Pose| TransformStamped {
                header: header("base"),
                child_frame_id: child.to_owned(),
                transform: Transform::from_pose(pose),
            };
            let message =
                TfMessage { transforms: vec![one("door", &pose), one("camera", &Pose::identity())] };
            bag.message("/tf", "tf2_msgs/msg/TFMessage", nanos, &message);
        }
    }
    bag.finish();
    path
}

fn diagnose(
    folder: &TempDir,
    twin: &Path,
    how: Recorded,
    options: &[&str],
) -> (Ended, Option<serde_json::Value>) {
    let runs: Vec<PathBuf> =
        (0..3).map(|r| write(folder, r, &door(r, 10.0, 0.0, DAMPING + HIDDEN), how)).collect();
    let out = folder.path().join("out");
    std::fs::remove_dir_all(&out).ok();
    let ended = end(Command::new(env!("CARGO_BIN_EXE_artitwin"))
        .arg("diagnose")
        .arg(twin)
        .args(&runs)
        .args(options)
        .arg("--out")
        .arg(&out));
    let report =
        std::fs::read(out.join("report.json")).ok().map(|bytes| serde_json::from_slice(&bytes).unwrap());
    (ended, report)
}

/// The damping that was found, and nothing else.
fn damping(report: &serde_json::Value) -> f64 {
    assert_eq!(report["verdict"], "named", "{report:#}");
    let findings = report["findings"].as_array().unwrap();
    assert_eq!(findings.len(), 1, "{report:#}");
    assert_eq!(findings[0]["effect"], "viscous_friction");
    findings[0]["parameters"][0]["value"].as_f64().unwrap()
}

#[test]
fn wrenches_poses_and_transforms_give_the_diagnosis_of_joint_states() {
    let folder = tempfile::tempdir().unwrap();
    let twin = twin(&folder, INERTIAL);
    let states = Recorded { states: Some(true), ..NOTHING };
    let expected = damping(&diagnose(&folder, &twin, states, &[]).1.unwrap());
    assert!((expected - HIDDEN).abs() < 0.05, "{expected}");
    let (wrench, pose) = (["--wrench", "/gauge=handle"], ["--pose", "/handle_pose=handle"]);
    let both = [wrench, pose].concat();
    let cases: [(&str, Recorded, &[&str]); 4] = [
        (
            "wrench in the handle's frame",
            Recorded { states: Some(false), wrench: Some("handle"), ..NOTHING },
            &wrench,
        ),
        ("wrench in the world", Recorded { states: Some(false), wrench: Some("world"), ..NOTHING }, &wrench),
        ("wrench and poses", Recorded { wrench: Some("handle"), poses: true, ..NOTHING }, &both),
        ("wrench and transforms", Recorded { wrench: Some("handle"), transforms: true, ..NOTHING }, &wrench),
    ];
    for (name, how, options) in cases {
        let (ended, report) = diagnose(&folder, &twin, how, options);
        let report = report.unwrap_or_else(|| panic!("{name}: {}", ended.stderr));
        let found = damping(&report);
        assert!((found - expected).abs() < 2e-3 * expected, "{name}: {found} {expected}");
        let told = report["off_axis"].as_array().unwrap();
        assert_eq!(told.len(), usize::from(how.poses || how.transforms), "{name}");
        assert!(told.iter().all(|t| t["suspect"] == "none"), "{name}: {told:?}");
    }
}

#[test]
fn a_hinge_that_stands_elsewhere_is_told_beside_the_diagnosis() {
    let folder = tempfile::tempdir().unwrap();
    let twin = twin(&folder, INERTIAL);
    let how = Recorded { states: Some(true), poses: true, off_m: 0.012, ..NOTHING };
    let (ended, report) = diagnose(&folder, &twin, how, &["--pose", "/handle_pose=handle"]);
    let report = report.unwrap_or_else(|| panic!("{}", ended.stderr));
    assert!((damping(&report) - HIDDEN).abs() < 0.05);
    let told = &report["off_axis"][0];
    assert_eq!(told["suspect"], "axis_offset", "{told:#}");
    assert!((told["axis"]["mm"].as_f64().unwrap() - 12.0).abs() < 1.0, "{told:#}");
    assert!(ended.stdout.contains("(axis_offset)"), "{}", ended.stdout);
}

#[test]
fn frames_links_and_topics_that_are_not_there_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let twin = twin(&folder, INERTIAL);
    let refused = |how: Recorded, options: &[&str], words: &[&str]| {
        let (ended, report) = diagnose(&folder, &twin, how, options);
        assert!(ended.code != 0 && report.is_none(), "{options:?}: {}", ended.stdout);
        words.iter().for_each(|w| assert!(ended.stderr.contains(w), "`{w}` is not in {}", ended.stderr));
    };
    let gauge = |frame| Recorded { states: Some(false), wrench: Some(frame), ..NOTHING };
    refused(
        gauge("sensor_frame"),
        &["--wrench", "/gauge=handle"],
        &["frame 'sensor_frame'", "'handle'", "header.frame_id"],
    );
    refused(gauge("handle"), &["--wrench", "/gauge=knob"], &["link 'knob'", "'door'"]);
    refused(gauge("handle"), &["--wrench", "/gauge=base"], &["link 'base' does not move"]);
    refused(
        gauge("handle"),
        &["--wrench", "/push=handle"],
        &["on '/push'", "/gauge (geometry_msgs/msg/WrenchStamped)"],
    );
    refused(gauge("handle"), &["--pose", "/gauge=handle"], &["PoseStamped on '/gauge'"]);
    refused(gauge("handle"), &["--wrench", "gauge"], &["TOPIC=LINK"]);
    refused(gauge("handle"), &[], &["no effort of joint 'door_joint'"]);
    refused(
        Recorded { poses: true, ..NOTHING },
        &["--pose", "/handle_pose=handle"],
        &["no effort of joint 'door_joint'", "wrench"],
    );
}
