//! `artitwin diagnose` on recordings that MuJoCo makes.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stderr, reason = "a test may panic")]

#[path = "common/harness.rs"]
mod harness;
#[path = "common/venv.rs"]
mod venv;

use std::{
    path::{Path, PathBuf},
    process::{Command, ExitCode},
};

use harness::{Missing, tests};

fn main() -> ExitCode {
    harness::main(tests![
        a_hidden_spring_is_named_and_the_gap_closes_in_mujoco_too,
        friction_in_the_middle_of_a_chain_is_named_at_its_joint,
    ])
}

/// Makes one case and diagnoses it: the runs and the report.
fn diagnose(
    folder: &Path,
    kind: &str,
    object: &str,
    effects: &[&str],
) -> Result<(Vec<PathBuf>, serde_json::Value), Missing> {
    let python = venv::python()?;
    let mut generate = Command::new(python);
    generate.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/gap/generate.py")).arg(folder);
    generate.args([
        "--kind",
        kind,
        "--seeds",
        "900:901",
        "--objects",
        object,
        "--noise",
        "mid",
        "--runs",
        "3",
    ]);
    if !effects.is_empty() {
        generate.arg("--effects").args(effects);
    }
    let output = generate.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let case = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .find(|p| p.join("twin.urdf").exists())
        .unwrap();
    let out = folder.join("result");
    let runs: Vec<PathBuf> = (0..3).map(|i| case.join(format!("run_{i}"))).collect();
    let output = Command::new(env!("CARGO_BIN_EXE_artitwin"))
        .arg("diagnose")
        .arg(case.join("twin.urdf"))
        .args(&runs)
        .arg("--out")
        .arg(&out)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8_lossy(&output.stdout).lines().count() <= 16);
    let report = std::fs::read_to_string(out.join("report.json")).unwrap();
    Ok((runs, serde_json::from_str(&report).unwrap()))
}

/// MuJoCo rolls the exported twin out over the held-out windows: its residual over the `after` of the report.
fn replayed(folder: &Path, runs: &[PathBuf]) -> f64 {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/gap/replay.py");
    let output = Command::new(venv::python().unwrap())
        .arg(script)
        .arg(folder.join("result"))
        .args(runs)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let line: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    line["mujoco"].as_f64().unwrap() / line["after"].as_f64().unwrap()
}

fn a_hidden_spring_is_named_and_the_gap_closes_in_mujoco_too() -> Result<(), Missing> {
    let temp = tempfile::tempdir().unwrap();
    let (runs, report) = diagnose(temp.path(), "single", "door", &["spring_return"])?;
    assert_eq!(report["findings"][0]["effect"], "spring_return", "{report:#}");
    let gap = |key: &str| report["gap"][key].as_f64().unwrap();
    assert!(gap("after") < 0.2 * gap("before") + gap("noise_floor"), "{report:#}");
    let ratio = replayed(temp.path(), &runs);
    assert!((ratio - 1.0).abs() < 0.03, "MuJoCo leaves {ratio} times what the report says");
    Ok(())
}

fn friction_in_the_middle_of_a_chain_is_named_at_its_joint() -> Result<(), Missing> {
    let temp = tempfile::tempdir().unwrap();
    let python = venv::python()?;
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/gap/chain.py");
    let case = temp.path().join("arm");
    let output = Command::new(python)
        .arg(script)
        .arg(&case)
        .args(["--friction", "0.4", "--seed", "3"])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let runs = (0..3).map(|i| case.join(format!("run_{i}")));
    let mut program = Command::new(env!("CARGO_BIN_EXE_artitwin"));
    let output = program
        .arg("diagnose")
        .arg(case.join("twin.urdf"))
        .args(runs)
        .arg("--out")
        .arg(temp.path().join("result"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(temp.path().join("result/report.json")).unwrap())
            .unwrap();
    let findings = report["findings"].as_array().unwrap();
    assert_eq!(findings.len(), 1, "{report:#}");
    assert_eq!(
        (&findings[0]["joint"], &findings[0]["effect"]),
        (&"lower_joint".into(), &"coulomb_friction".into()),
        "{report:#}"
    );
    let friction = findings[0]["parameters"][0]["value"].as_f64().unwrap();
    assert!((friction - 0.4).abs() < 0.02, "{friction}");
    Ok(())
}
