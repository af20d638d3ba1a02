//! Several objects in one command: one that fails does not stop the rest.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

mod common;
#[path = "common/program.rs"]
mod program;

use std::path::{Path, PathBuf};

use program::{end, reconstruct, shipped};

#[test]
fn one_bad_recording_does_not_stop_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let (together, alone) = (folder.path().join("together"), folder.path().join("alone"));
    let bags = [shipped("drawer"), folder.path().join("missing"), shipped("laptop")];
    let ended = end(&mut reconstruct(
        &bags.each_ref().map(PathBuf::as_path),
        &together,
        &["--parts", "2", "--jobs", "2"],
    ));
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    assert!(ended.stderr.contains("1 of 3 objects failed"), "{}", ended.stderr);
    assert!(ended.stderr.contains("failed: ") && ended.stderr.contains("missing"), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("drawer/match") && ended.stderr.contains("laptop/match"),
        "{}",
        ended.stderr
    );

    let single = end(&mut reconstruct(&[&shipped("drawer")], &alone, &["--parts", "2"]));
    assert!([0, 3].contains(&single.code), "{}", single.stderr);
    let urdf = |out: &Path| std::fs::read(out.join("drawer/drawer.urdf")).unwrap();
    assert_eq!(urdf(&together), urdf(&alone));
    assert!(together.join("laptop/report.json").is_file());
}

#[test]
fn two_objects_of_one_name_are_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let bag = shipped("drawer");
    let ended =
        end(&mut reconstruct(&[&bag, &bag], &folder.path().join("runs"), &["--parts", "2", "--jobs", "1"]));
    assert_eq!(ended.code, 2, "{}", ended.stderr);
    assert!(ended.stderr.contains("both be named drawer"), "{}", ended.stderr);
    assert!(!folder.path().join("runs").exists());
}
