//! `artitwin diagnose` on recordings that MuJoCo makes; skipped where there is no Python.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stderr, reason = "a test may panic")]

#[path = "common/venv.rs"]
mod venv;

use std::{
    path::{Path, PathBuf},
    process::Command,
};

struct Temp(PathBuf);

impl Temp {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("artitwin-gap-{name}-{}", std::process::id()));
        std::fs::remove_dir_all(&path).ok();
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }
}

impl Drop for Temp {
    fn drop(&mut self) {
        std::fs::remove_dir_all(&self.0).ok();
    }
}

/// Makes one case and diagnoses it; `None` without Python.
fn diagnose(folder: &Path, kind: &str, object: &str, effects: &[&str]) -> Option<serde_json::Value> {
    let python = venv::python()?;
    let mut generate = Command::new(python);
    generate.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/gap/generate.py")).arg(folder);
    generate.args(["--kind", kind, "--seeds", "900:901", "--objects", object, "--noise", "mid", "--runs", "3"]);
    if !effects.is_empty() {
        generate.arg("--effects").args(effects);
    }
    let output = generate.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let case = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).find(|p| p.join("twin.urdf").exists()).unwrap();
    let out = folder.join("result");
    let runs = (0..3).map(|i| case.join(format!("run_{i}")));
    let output = Command::new(env!("CARGO_BIN_EXE_artitwin"))
        .arg("diagnose")
        .arg(case.join("twin.urdf"))
        .args(runs)
        .arg("--out")
        .arg(&out)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8_lossy(&output.stdout).lines().count() <= 16);
    Some(serde_json::from_str(&std::fs::read_to_string(out.join("report.json")).unwrap()).unwrap())
}

#[test]
fn a_hidden_spring_is_named_and_the_gap_closes() {
    let temp = Temp::new("spring");
    let Some(report) = diagnose(&temp.0, "single", "door", &["spring_return"]) else { return };
    assert_eq!(report["findings"][0]["effect"], "spring_return", "{report:#}");
    let gap = |key: &str| report["gap"][key].as_f64().unwrap();
    assert!(gap("after") < 0.2 * gap("before") + gap("noise_floor"), "{report:#}");
}

#[test]
fn nothing_hidden_gets_no_name() {
    let temp = Temp::new("nothing");
    let Some(report) = diagnose(&temp.0, "null", "drawer", &[]) else { return };
    assert_eq!(report["verdict"], "none", "{report:#}");
    assert_eq!(report["findings"].as_array().unwrap().len(), 0);
}

#[test]
fn a_damper_of_one_way_and_place_is_unknown() {
    let temp = Temp::new("outside");
    let Some(report) = diagnose(&temp.0, "outside", "drawer", &["one_way_band_damper"]) else { return };
    assert_eq!(report["verdict"], "unknown", "{report:#}");
    assert!(!report["where"].as_array().unwrap().is_empty());
}

#[test]
fn a_wrong_joint_name_is_told() {
    let Some(python) = venv::python() else { return };
    let temp = Temp::new("joint");
    let generate = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/gap/generate.py");
    let made = Command::new(python)
        .arg(generate)
        .arg(&temp.0)
        .args(["--kind", "null", "--objects", "door", "--noise", "mid", "--runs", "1"])
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let case = temp.0.join("door_nothing_mid_0");
    let twin = std::fs::read_to_string(case.join("twin.urdf")).unwrap().replace("door_joint", "gate_joint");
    std::fs::write(case.join("twin.urdf"), twin).unwrap();
    let out = temp.0.join("result");
    let output = Command::new(env!("CARGO_BIN_EXE_artitwin"))
        .arg("diagnose")
        .arg(case.join("twin.urdf"))
        .arg(case.join("run_0"))
        .arg("--out")
        .arg(&out)
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(text.contains("no joint 'gate_joint'") && text.contains("'door_joint'"), "{text}");
    assert!(!out.exists());
}
