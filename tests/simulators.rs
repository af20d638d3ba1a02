//! The exported URDF in MuJoCo and PyBullet: they load it, and each joint moves the right parts to the right
//! places.
//!
//! Needs Python (see `common/venv.rs`). Pictures go to `target/pictures/`.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stderr, reason = "a test may panic")]

#[path = "common/harness.rs"]
mod harness;
#[path = "common/objects.rs"]
mod objects;
#[path = "common/venv.rs"]
mod venv;

use std::{
    collections::BTreeMap,
    path::Path,
    process::{Command, ExitCode},
};

use harness::{Missing, tests};
use model::ArticulatedModel;
use objects::{desk, true_drawer, write_run, write_truth};

fn main() -> ExitCode {
    harness::main(tests![
        a_chain_and_a_drawer_move_in_both_simulators,
        the_true_drawer_moves_in_both_simulators,
        truth_folders_say_what_the_model_says,
    ])
}

/// Where the model itself says its links are.
fn poses(model: &ArticulatedModel) -> serde_json::Value {
    let rows = |link: usize, q: &[f64]| -> Vec<Vec<f64>> {
        model
            .world_from_link(link, q)
            .to_homogeneous()
            .row_iter()
            .map(|r| r.iter().copied().collect())
            .collect()
    };
    let pose = |q: &Vec<f64>| {
        let joints: BTreeMap<&str, f64> =
            model.joints.iter().map(|j| j.name.as_str()).zip(q.iter().copied()).collect();
        let links: BTreeMap<&str, _> =
            model.links.iter().enumerate().map(|(i, l)| (l.name.as_str(), rows(i, q))).collect();
        serde_json::json!({ "joints": joints, "world_from_link": links })
    };
    let upper: Vec<f64> = model.joints.iter().map(|j| j.limit.upper).collect();
    serde_json::json!({
        "links": model.links.iter().map(|l| &l.name).collect::<Vec<_>>(),
        "joints": model.joints.iter().map(|j| &j.name).collect::<Vec<_>>(),
        "poses": model.states.iter().chain([&upper]).map(pose).collect::<Vec<_>>(),
    })
}

fn check(model: &ArticulatedModel) -> Result<(), Missing> {
    let python = venv::python()?;
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let temp = tempfile::tempdir().unwrap();
    let folder = write_run(model, temp.path());
    let expected = temp.path().join("poses.json");
    std::fs::write(&expected, poses(model).to_string()).expect("a written file");
    let mut command = Command::new(&python);
    command.arg(root.join("tests/python/check_urdf.py")).arg(folder.join(format!("{}.urdf", model.name)));
    command
        .arg("--poses")
        .arg(&expected)
        .arg("--pictures")
        .arg(root.join("target/pictures").join(&model.name));
    let output = command.output().expect("python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8_lossy(&output.stdout);
    let summary: serde_json::Value =
        serde_json::from_str(text.lines().last().unwrap_or_default()).expect("a summary");
    for simulator in ["mujoco", "pybullet"] {
        let found = &summary[simulator];
        assert_eq!(found["links"].as_u64(), Some(model.links.len() as u64), "{simulator}");
        assert_eq!(found["joints"].as_u64(), Some(model.joints.len() as u64), "{simulator}");
        // PyBullet gives a fixed base no mass.
        for link in model.links.iter().skip(usize::from(simulator == "pybullet")) {
            let mass = found["masses"][&link.name].as_f64().expect("a mass");
            assert!(
                (mass - link.inertial.mass_kg).abs() < 1e-6,
                "{simulator}: {} weighs {mass} kg",
                link.name
            );
        }
        assert_eq!(found["contacts"].as_u64(), Some(0), "{simulator}");
    }
    Ok(())
}

fn a_chain_and_a_drawer_move_in_both_simulators() -> Result<(), Missing> {
    check(&desk())
}

fn the_true_drawer_moves_in_both_simulators() -> Result<(), Missing> {
    check(&true_drawer())
}

/// The truth that other tests measure against, checked by the same poses: a part moves from state 0 to state
/// 1.
fn truth_folders_say_what_the_model_says() {
    let temp = tempfile::tempdir().unwrap();
    write_truth(&desk(), temp.path());
    let truth = evaluate::Truth::read(temp.path()).expect("a truth");
    for part in &truth.parts {
        let Some(joint) = &part.joint else { continue };
        let there = part.meshes[0].transformed(&joint.state1_from_state0);
        let worst = there
            .vertices
            .iter()
            .zip(&part.meshes[1].vertices)
            .map(|(a, b)| (a - b).norm())
            .fold(0.0, f32::max);
        assert!(worst < 1e-6, "{}: {worst}", part.name);
    }
}
