//! `reconstruct --rerun FILE.rrd`: the recording beside the twin, and the refusal of a build without it.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

use std::{
    path::{Path, PathBuf},
    process::{Command, Output},
};

/// A preview of the shipped drawer that also writes `recording`, with the folder of its runs.
fn reconstruct(runs: &str, recording: &Path) -> (Output, PathBuf) {
    let runs = Path::new(env!("CARGO_TARGET_TMPDIR")).join(runs);
    std::fs::remove_dir_all(&runs).ok();
    let output = Command::new(env!("CARGO_BIN_EXE_artitwin"))
        .args(["reconstruct", "bags/drawer_raw", "--preset", "preview", "--out"])
        .arg(&runs)
        .arg("--rerun")
        .arg(recording)
        .output()
        .unwrap();
    (output, runs)
}

#[cfg(not(feature = "rerun"))]
#[test]
fn a_build_without_rerun_refuses_the_option_and_says_how_to_build_one() {
    let (output, runs) = reconstruct("rerun-absent", Path::new("never.rrd"));
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(told.contains("cargo build --release --features rerun"), "{told}");
    assert!(!runs.exists());
}

#[cfg(feature = "rerun")]
#[test]
fn a_recording_is_written_beside_the_twin_and_replaces_nothing() {
    let recording = Path::new(env!("CARGO_TARGET_TMPDIR")).join("drawer.rrd");
    std::fs::remove_file(&recording).ok();
    let (output, runs) = reconstruct("rerun-drawer", &recording);
    let told = String::from_utf8_lossy(&output.stderr);
    assert!([Some(0), Some(3)].contains(&output.status.code()), "{told}");
    assert!(runs.join("drawer_raw/drawer_raw.urdf").exists());
    let bytes = std::fs::read(&recording).unwrap();
    assert!(bytes.starts_with(b"RRF2"), "{:?}", &bytes[..8]);
    // Views of both states and textured parts, compressed.
    assert!(bytes.len() > 100_000, "{} bytes", bytes.len());

    let (output, runs) = reconstruct("rerun-taken", &recording);
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{told}");
    assert!(told.contains("give --rerun a name that is not taken"), "{told}");
    assert!(std::fs::read(&recording).unwrap() == bytes && !runs.join("drawer_raw").exists());
}
