//! Recordings that `artitwin diagnose` cannot use, or can use in part: it says what is missing and what to
//! record instead, and gives no name. One door, simulated here, in which nothing is hidden.

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

use artitwin::internal::io::ros2msg::{Header, JointState, Time};
use common::{BagWriter, START, TempDir};
use door::{DAMPING, INERTIAL, Sample, door, twin};
use program::{Ended, end};

fn write(folder: &TempDir, name: &str, samples: &[Sample]) -> PathBuf {
    let path = folder.join(&format!("{name}.mcap"));
    let mut bag = BagWriter::create(&path, None, 100_000);
    for s in samples {
        let nanos = START + (s.time_s * 1e9).round() as i64;
        let stamp = Time { sec: (nanos / 1_000_000_000) as i32, nanosec: (nanos % 1_000_000_000) as u32 };
        let state = JointState {
            header: Header { stamp, frame_id: String::new() },
            name: vec!["door_joint".to_owned()],
            position: s.position.clone(),
            velocity: Vec::new(),
            effort: s.effort.clone(),
        };
        bag.message("/joint_states", "sensor_msgs/msg/JointState", nanos, &state);
    }
    bag.finish();
    path
}

fn diagnose(folder: &TempDir, twin: &Path, runs: &[PathBuf]) -> (Ended, Option<serde_json::Value>) {
    let out = folder.join("out");
    let ended = end(Command::new(env!("CARGO_BIN_EXE_artitwin"))
        .arg("diagnose")
        .arg(twin)
        .args(runs)
        .arg("--out")
        .arg(&out));
    let report =
        std::fs::read(out.join("report.json")).ok().map(|bytes| serde_json::from_slice(&bytes).unwrap());
    (ended, report)
}

/// Three runs that went through `change`.
fn changed(folder: &TempDir, seconds: f64, uneven: f64, change: impl Fn(&mut Vec<Sample>)) -> Vec<PathBuf> {
    let one = |run: usize| {
        let mut samples = door(run, seconds, uneven, DAMPING);
        change(&mut samples);
        write(folder, &format!("run_{run}"), &samples)
    };
    (0..3).map(one).collect()
}

/// Runs that must be refused, with these words.
fn refused(name: &str, inertial: &str, words: &[&str], change: impl Fn(&mut Vec<Sample>)) {
    let folder = TempDir::new(name);
    let runs = changed(&folder, 8.0, 0.0, change);
    let (ended, report) = diagnose(&folder, &twin(&folder, inertial), &runs);
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    words.iter().for_each(|w| assert!(ended.stderr.contains(w), "`{w}` is not in {}", ended.stderr));
    assert!(report.is_none() && !folder.join("out").exists());
}

/// Runs that are used, but give no name; `words` are in the warnings.
fn unnamed(
    name: &str,
    verdict: &str,
    words: &[&str],
    (seconds, uneven): (f64, f64),
    change: impl Fn(&mut Vec<Sample>),
) {
    let folder = TempDir::new(name);
    let runs = changed(&folder, seconds, uneven, change);
    let (ended, report) = diagnose(&folder, &twin(&folder, INERTIAL), &runs);
    let report = report.unwrap_or_else(|| panic!("{}", ended.stderr));
    assert_eq!(report["verdict"], verdict, "{report:#}");
    assert_eq!(report["findings"].as_array().unwrap().len(), 0, "{report:#}");
    let told = format!("{}{}", ended.stderr, ended.stdout);
    words.iter().for_each(|w| assert!(told.contains(w), "`{w}` is not in {told}"));
}

#[test]
fn nothing_wrong() {
    unnamed("gap-good", "none", &[], (8.0, 0.0), |_| {});
}

#[test]
fn no_effort() {
    refused("gap-effort", INERTIAL, &["no effort of joint 'door_joint'", "record the effort"], |s| {
        s.iter_mut().for_each(|s| s.effort.clear());
    });
}

#[test]
fn no_position() {
    refused("gap-position", INERTIAL, &["no position of joint 'door_joint'"], |s| {
        s.iter_mut().for_each(|s| s.position.clear())
    });
}

#[test]
fn a_twin_without_mass() {
    refused("gap-mass", "", &["'door_joint' moves no mass", "<inertial>"], |_| {});
}

#[test]
fn signals_that_do_not_change() {
    unnamed("gap-constant", "insufficient", &["move the joint through most of its range"], (8.0, 0.0), |s| {
        let first = s[0].clone();
        s.iter_mut().for_each(|s| (s.position, s.effort) = (first.position.clone(), vec![0.0]));
    });
}

#[test]
fn a_joint_that_is_pushed_and_does_not_move() {
    unnamed("gap-stuck", "insufficient", &["move the joint through most of its range"], (8.0, 0.0), |s| {
        s.iter_mut().for_each(|s| s.position[0] = 0.4);
    });
}

#[test]
fn stamps_that_stand_still() {
    refused("gap-clock", INERTIAL, &["1 usable samples of joint 'door_joint'", "record 10 s or more"], |s| {
        s.iter_mut().for_each(|s| s.time_s = 0.0);
    });
}

#[test]
fn one_run_of_three_without_effort() {
    let folder = TempDir::new("gap-one-effort");
    let mut runs = changed(&folder, 8.0, 0.0, |_| {});
    let mut last = door(2, 8.0, 0.0, DAMPING);
    last.iter_mut().for_each(|s| s.effort.clear());
    runs[2] = write(&folder, "run_2", &last);
    let (ended, report) = diagnose(&folder, &twin(&folder, INERTIAL), &runs);
    assert_eq!(ended.code, 1, "{}", ended.stdout);
    assert!(ended.stderr.contains("run 'run_2' has no effort of joint 'door_joint'"), "{}", ended.stderr);
    assert!(report.is_none());
}

#[test]
fn a_run_of_two_seconds() {
    let folder = TempDir::new("gap-short");
    let run = write(&folder, "run_0", &door(0, 2.0, 0.0, DAMPING));
    let (ended, report) = diagnose(&folder, &twin(&folder, INERTIAL), &[run]);
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    assert!(ended.stdout.contains("record 10 s or more"), "{}", ended.stdout);
    assert_eq!(report.unwrap()["verdict"], "insufficient");
}

#[test]
fn irregular_stamps() {
    unnamed("gap-irregular", "none", &[], (10.0, 0.5), |_| {});
}

#[test]
fn stamps_that_repeat() {
    unnamed("gap-repeat", "none", &["stamps repeat or run backward"], (8.0, 0.0), |s| {
        let copies: Vec<Sample> = s.iter().step_by(10).cloned().collect();
        s.extend(copies);
        s.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    });
}

#[test]
fn a_gap() {
    unnamed("gap-gap", "none", &[], (10.0, 0.0), |s| s.retain(|s| !(3.0..4.2).contains(&s.time_s)));
}

#[test]
fn values_that_are_no_numbers() {
    unnamed("gap-nan", "none", &["not a number"], (8.0, 0.0), |s| {
        s.iter_mut().step_by(37).for_each(|s| s.position[0] = f64::NAN);
        s.iter_mut().skip(5).step_by(53).for_each(|s| s.effort[0] = f64::INFINITY);
    });
}

#[test]
fn a_joint_of_another_name() {
    let folder = TempDir::new("gap-name");
    let runs = changed(&folder, 8.0, 0.0, |_| {});
    let twin = twin(&folder, INERTIAL);
    let text = std::fs::read_to_string(&twin).unwrap().replace("door_joint", "gate_joint");
    std::fs::write(&twin, text).unwrap();
    let (ended, report) = diagnose(&folder, &twin, &runs);
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    assert!(
        ended.stderr.contains("no joint 'gate_joint'") && ended.stderr.contains("'door_joint'"),
        "{}",
        ended.stderr
    );
    assert!(report.is_none());
}
