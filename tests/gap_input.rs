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

use common::{BagWriter, START};
use door::{DAMPING, INERTIAL, Sample, door, twin};
use io::ros2msg::{Header, JointState, Time};
use program::{Ended, end};
use tempfile::TempDir;

fn write(folder: &TempDir, name: &str, samples: &[Sample]) -> PathBuf {
    write_commanded(folder, name, samples, &[])
}

/// With the positions that a servo was given, where there are any.
fn write_commanded(folder: &TempDir, name: &str, samples: &[Sample], commands: &[f64]) -> PathBuf {
    let path = folder.path().join(format!("{name}.mcap"));
    let mut bag = BagWriter::create(&path, None, 100_000);
    for (k, s) in samples.iter().enumerate() {
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
        if let Some(command) = commands.get(k) {
            let sent = JointState { position: vec![*command], effort: Vec::new(), ..state };
            bag.message("/joint_commands", "sensor_msgs/msg/JointState", nanos, &sent);
        }
    }
    bag.finish();
    path
}

fn diagnose(folder: &TempDir, twin: &Path, runs: &[PathBuf]) -> (Ended, Option<serde_json::Value>) {
    let out = folder.path().join("out");
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
fn refused(inertial: &str, words: &[&str], change: impl Fn(&mut Vec<Sample>)) {
    let folder = tempfile::tempdir().unwrap();
    let runs = changed(&folder, 8.0, 0.0, change);
    let (ended, report) = diagnose(&folder, &twin(&folder, inertial), &runs);
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    words.iter().for_each(|w| assert!(ended.stderr.contains(w), "`{w}` is not in {}", ended.stderr));
    assert!(report.is_none() && !folder.path().join("out").exists());
}

/// Runs that are used, but give no name; `words` are in the warnings.
fn unnamed(verdict: &str, words: &[&str], (seconds, uneven): (f64, f64), change: impl Fn(&mut Vec<Sample>)) {
    let folder = tempfile::tempdir().unwrap();
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
    unnamed("none", &[], (8.0, 0.0), |_| {});
}

#[test]
fn no_effort() {
    refused(INERTIAL, &["no effort of joint 'door_joint'", "record the effort"], |s| {
        s.iter_mut().for_each(|s| s.effort.clear());
    });
}

#[test]
fn no_position() {
    refused(INERTIAL, &["no position of joint 'door_joint'"], |s| {
        s.iter_mut().for_each(|s| s.position.clear())
    });
}

#[test]
fn a_twin_without_mass() {
    refused("", &["'door_joint' moves no mass", "<inertial>"], |_| {});
}

#[test]
fn signals_that_do_not_change() {
    unnamed("insufficient", &["move the joint through most of its range"], (8.0, 0.0), |s| {
        let first = s[0].clone();
        s.iter_mut().for_each(|s| (s.position, s.effort) = (first.position.clone(), vec![0.0]));
    });
}

#[test]
fn a_joint_that_is_pushed_and_does_not_move() {
    unnamed("insufficient", &["move the joint through most of its range"], (8.0, 0.0), |s| {
        s.iter_mut().for_each(|s| s.position[0] = 0.4);
    });
}

#[test]
fn stamps_that_stand_still() {
    refused(INERTIAL, &["1 usable samples of joint 'door_joint'", "record 10 s or more"], |s| {
        s.iter_mut().for_each(|s| s.time_s = 0.0);
    });
}

#[test]
fn one_run_of_three_without_effort() {
    let folder = tempfile::tempdir().unwrap();
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
    let folder = tempfile::tempdir().unwrap();
    let run = write(&folder, "run_0", &door(0, 2.0, 0.0, DAMPING));
    let (ended, report) = diagnose(&folder, &twin(&folder, INERTIAL), &[run]);
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    assert!(ended.stdout.contains("record 10 s or more"), "{}", ended.stdout);
    assert_eq!(report.unwrap()["verdict"], "insufficient");
}

#[test]
fn irregular_stamps() {
    unnamed("none", &[], (10.0, 0.5), |_| {});
}

#[test]
fn stamps_that_repeat() {
    unnamed("none", &["stamps repeat or run backward"], (8.0, 0.0), |s| {
        let copies: Vec<Sample> = s.iter().step_by(10).cloned().collect();
        s.extend(copies);
        s.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    });
}

#[test]
fn a_gap() {
    unnamed("none", &[], (10.0, 0.0), |s| s.retain(|s| !(3.0..4.2).contains(&s.time_s)));
}

#[test]
fn values_that_are_no_numbers() {
    unnamed("none", &["not a number"], (8.0, 0.0), |s| {
        s.iter_mut().step_by(37).for_each(|s| s.position[0] = f64::NAN);
        s.iter_mut().skip(5).step_by(53).for_each(|s| s.effort[0] = f64::INFINITY);
    });
}

#[test]
fn a_joint_of_another_name() {
    let folder = tempfile::tempdir().unwrap();
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

/// Runs of the door that went through `change`, its twin through `edit`; with what the program says.
fn doubted(edit: impl Fn(String) -> String, change: impl Fn(&mut Vec<Sample>)) -> (Ended, serde_json::Value) {
    let folder = tempfile::tempdir().unwrap();
    let runs = changed(&folder, 10.0, 0.0, change);
    let path = twin(&folder, INERTIAL);
    std::fs::write(&path, edit(std::fs::read_to_string(&path).unwrap())).unwrap();
    let (ended, report) = diagnose(&folder, &path, &runs);
    let page = std::fs::read_to_string(folder.path().join("out/report.html")).unwrap_or_default();
    let report = report.unwrap_or_else(|| panic!("{}", ended.stderr));
    let doubt = &report["doubts"][0];
    let looks = doubt["looks"][0].as_str().unwrap_or_else(|| panic!("{report:#}"));
    // The page escapes apostrophes.
    assert!(page.contains(&looks.replace('\'', "&#39;")), "{looks}");
    assert!(ended.stdout.contains(looks) && ended.stderr.contains(looks), "{looks}");
    assert_eq!(report["verdict"], "unknown");
    assert_eq!(report["findings"].as_array().unwrap().len(), 0);
    assert_eq!(report["warnings"][0]["code"], doubt["code"]);
    assert_eq!(ended.code, 3, "{}", ended.stdout);
    (ended, report)
}

#[test]
fn a_twin_in_millimeters() {
    // 1 m from the hinge is 1000 mm.
    let edit = |text: String| text.replace("<origin xyz=\"1 0 0\"/><mass", "<origin xyz=\"1000 0 0\"/><mass");
    let (_, report) = doubted(edit, |_| {});
    assert_eq!(report["doubts"][0]["code"], "units_doubtful");
    let looks = report["doubts"][0]["looks"].to_string();
    assert!(looks.contains("millimeters"), "{looks}");
    let ratio = report["doubts"][0]["inertia_ratio"].as_f64().unwrap();
    assert!((5e5..2e6).contains(&ratio), "{ratio}");
}

#[test]
fn a_twin_in_grams() {
    let edit = |text: String| text.replace("<mass value=\"2\"/>", "<mass value=\"2000\"/>");
    let (_, report) = doubted(edit, |_| {});
    // Without a load, positions in degrees beside an inertia that is off look the same.
    assert_eq!(report["doubts"][0]["code"], "units_doubtful");
    let ratio = report["doubts"][0]["inertia_ratio"].as_f64().unwrap();
    assert!((900.0..1100.0).contains(&ratio), "{ratio}");
}

#[test]
fn efforts_of_the_opposite_sign() {
    let turn = |s: &mut Vec<Sample>| s.iter_mut().for_each(|s| s.effort[0] = -s.effort[0]);
    let (ended, report) = doubted(|text| text, turn);
    assert_eq!(report["doubts"][0]["code"], "effort_sign_turned");
    assert!(ended.stderr.contains("--effort-unit -1"), "{}", ended.stderr);
}

#[test]
fn efforts_without_a_sign() {
    refused(INERTIAL, &["never negative", "with its sign", "--command"], |s| {
        s.iter_mut().for_each(|s| s.effort[0] = s.effort[0].abs());
    });
}

#[test]
fn efforts_without_a_sign_get_that_of_the_command() {
    let folder = tempfile::tempdir().unwrap();
    let runs: Vec<PathBuf> = (0..3)
        .map(|run| {
            let samples = door(run, 10.0, 0.0, DAMPING);
            // A servo of 20 N m/rad whose load is read in steps of a hundredth.
            let commands: Vec<f64> = samples.iter().map(|s| s.position[0] + s.effort[0] / 20.0).collect();
            let mut read = samples;
            read.iter_mut().for_each(|s| s.effort[0] = (100.0 * s.effort[0].abs()).round() / 100.0);
            write_commanded(&folder, &format!("run_{run}"), &read, &commands)
        })
        .collect();
    let (ended, report) = diagnose(&folder, &twin(&folder, INERTIAL), &runs);
    let report = report.unwrap_or_else(|| panic!("{}", ended.stderr));
    assert!(ended.stderr.contains("that of the command less the position"), "{}", ended.stderr);
    assert_eq!(report["warnings"][0]["code"], "efforts_without_sign");
    assert_eq!(report["verdict"], "none", "{report:#}");
}

#[test]
fn inspect_says_what_a_bag_of_joint_states_is_good_for() {
    let folder = tempfile::tempdir().unwrap();
    let inspect = |path: &Path| end(Command::new(env!("CARGO_BIN_EXE_artitwin")).arg("inspect").arg(path));
    let whole = write(&folder, "whole", &door(0, 5.0, 0.0, DAMPING));
    let said = inspect(&whole);
    assert_eq!(said.code, 0, "{}", said.stdout);
    for words in [
        "door_joint: 500 samples, 5.0 s, 100.0 Hz, positions, efforts; usable by diagnose",
        "usable: yes, by diagnose",
    ] {
        assert!(said.stdout.contains(words), "`{words}` is not in {}", said.stdout);
    }
    let mut without = door(0, 5.0, 0.0, DAMPING);
    without.iter_mut().for_each(|s| s.effort.clear());
    let said = inspect(&write(&folder, "without", &without));
    assert_eq!(said.code, 1, "{}", said.stdout);
    assert!(said.stdout.contains("no effort of joint 'door_joint'"), "{}", said.stdout);
}
