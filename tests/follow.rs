//! Recordings followed while they are written.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]
#![cfg(unix)]

mod common;
#[path = "common/program.rs"]
mod program;

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
    thread::{self, sleep},
    time::Duration,
};

use program::{end, reconstruct, shipped};
use serde_json::Value;

/// Writes a shipped state in pieces, as a recorder does; its metadata last.
fn record(state: &Path, to: &Path, pieces: usize) {
    let name = format!("{}.mcap", to.file_name().unwrap().to_str().unwrap());
    let bytes = fs::read(state.join(&name)).unwrap();
    fs::create_dir_all(to).unwrap();
    for piece in 1..=pieces {
        fs::write(to.join(&name), &bytes[..bytes.len() * piece / pieces]).unwrap();
        sleep(Duration::from_millis(150));
    }
    fs::copy(state.join("metadata.yaml"), to.join("metadata.yaml")).unwrap();
}

fn states(of: &str) -> [PathBuf; 2] {
    ["state0", "state1"].map(|s| shipped(of).join(s))
}

/// Files of a twin but those that hold times and paths.
fn files(out: &Path) -> Vec<(String, Vec<u8>)> {
    ["drawer.urdf", "drawer.xml", "drawer.usda", "meshes/visual/base.obj"]
        .map(|f| (f.to_owned(), fs::read(out.join("drawer").join(f)).unwrap()))
        .into()
}

#[test]
fn a_recording_that_is_followed_gives_the_files_of_one_that_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let plain = folder.path().join("plain");
    let ended = end(&mut reconstruct(&[&shipped("drawer")], &plain, &["--json"]));
    assert!([0, 3].contains(&ended.code), "{}", ended.stderr);
    // Not there yet when the program begins.
    let session = folder.path().join("drawer");
    let writer = {
        let session = session.clone();
        thread::spawn(move || {
            sleep(Duration::from_millis(500));
            for (state, from) in states("drawer").iter().enumerate() {
                record(from, &session.join(format!("state{state}")), 12);
            }
        })
    };
    let followed = folder.path().join("followed");
    let ended = end(&mut reconstruct(&[&session], &followed, &["--json", "--follow"]));
    assert!([0, 3].contains(&ended.code), "{}", ended.stderr);
    writer.join().unwrap();
    assert!(files(&plain) == files(&followed), "the files differ");
    let events: Vec<Value> = ended.stdout.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    let place = |event: &str, stage: &str| {
        events.iter().position(|e| e["event"] == event && e["stage"] == stage).unwrap()
    };
    let order = [
        place("stage_started", "follow/state0"),
        place("stage_finished", "follow/state0"),
        place("stage_started", "follow/state1"),
        place("stage_finished", "follow/state1"),
        place("stage_started", "capture"),
    ];
    assert!(order.is_sorted(), "{order:?}");
    let grew = events.iter().filter(|e| e["code"] == "recording_grows").count();
    assert!(grew >= 2, "{}", ended.stdout);
}

#[test]
fn what_is_closed_is_not_waited_for_and_who_waits_may_be_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let bags = states("drawer");
    let ended =
        end(&mut reconstruct(&[&bags[0], &bags[1]], &folder.path().join("runs"), &["--json", "--follow"]));
    assert!([0, 3].contains(&ended.code), "{}", ended.stderr);
    // A recording that never comes.
    let mut waiting = reconstruct(
        &[&bags[0], &folder.path().join("never")],
        &folder.path().join("waiting"),
        &["--json", "--follow"],
    );
    let mut child = waiting.spawn().unwrap();
    sleep(Duration::from_secs(2));
    assert!(child.try_wait().unwrap().is_none());
    Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(!folder.path().join("waiting").join("drawer").exists());
}
