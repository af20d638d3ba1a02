//! The whole folder in simulators and in a browser: every importer counts the same, the object rests, opens
//! and holds a ball.
//!
//! Needs Python (see `common/venv.rs`), chromium for the pages, and `check_urdf`.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stderr, reason = "a test may panic")]

#[path = "common/harness.rs"]
mod harness;
#[path = "common/objects.rs"]
mod objects;
#[path = "common/venv.rs"]
mod venv;

use std::{
    path::{Path, PathBuf},
    process::{Command, ExitCode},
};

use artitwin::{Monitor, ReconstructRequest, reconstruct};
use export::{ExportConfig, Level, check_folder};
use harness::{Missing, tests};
use io::read_model_folder;
use model::{ArticulatedModel, LimitPolicy, LimitSource, Material, ModelConfig, PartNames, renamed_model};
use objects::{chest, chest_with, jar, lamp, write_run, write_run_as};
use tempfile::TempDir;

fn main() -> ExitCode {
    harness::main(tests![
        every_importer_counts_what_the_model_holds,
        urdfdom_counts_the_joints,
        a_chest_rests_opens_and_its_drawer_holds_a_ball,
        a_lid_that_hangs_in_the_air_is_held_by_its_friction,
        a_lid_on_a_thread_holds_turns_and_stays_on_it,
        scenes_and_ros_files_say_the_same_as_the_twin,
        the_reconstructed_drawer_holds_a_ball,
        the_reconstructed_laptop_looks_in_mujoco_as_in_the_photos,
        limits_lie_between_what_was_seen_and_what_is_free,
        masses_follow_the_material_and_stay_in_their_range,
        everything_that_the_viewer_offers_does_something_and_fits_every_screen,
        no_text_of_the_report_is_cut_on_any_screen,
    ])
}

/// Runs a script of `tests/python` and gives the JSON of its last line.
fn script(python: &Path, name: &str, arguments: &[&str]) -> serde_json::Value {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python").join(name);
    let output = Command::new(python).arg(script).args(arguments).output().expect("python runs");
    assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8_lossy(&output.stdout);
    serde_json::from_str(text.lines().last().unwrap_or_default()).expect("JSON")
}

fn written(model: &ArticulatedModel, temp: &TempDir) -> PathBuf {
    checked(write_run(model, temp.path()))
}

/// A run folder in which `check` finds no error.
fn checked(folder: PathBuf) -> PathBuf {
    let found = check_folder(&read_model_folder(&folder).unwrap());
    let errors: Vec<String> =
        found.iter().filter(|f| f.level == Level::Error).map(ToString::to_string).collect();
    assert!(errors.is_empty(), "{}", errors.join("\n"));
    folder
}

fn every_importer_counts_what_the_model_holds() -> Result<(), Missing> {
    let python = venv::python()?;
    for mut model in [chest(), lamp()] {
        // A wall of one part is assumed: a mesh and a texture more.
        model.links[1].assumed = model.links[1].collision[0].to_mesh();
        let meshes = model.links.len() + 1;
        let temp = tempfile::tempdir().unwrap();
        let folder = written(&model, &temp);
        let found = script(&python, "handoff_importers.py", &[folder.to_str().unwrap(), &model.name]);
        let solids: usize = model.links.iter().map(|l| l.collision.len()).sum();
        let mass: f64 = model.links.iter().map(|l| l.inertial.mass_kg).sum();
        let counts = [
            ("links", model.links.len()),
            ("joints", model.joints.len()),
            ("solids", solids),
            ("visuals", meshes),
        ];
        let extra = [
            ("textures", meshes),
            // One more where all are closed.
            ("states", model.states.len() + usize::from(model.closed_state().is_some())),
            ("excludes", model.joints.len()),
        ];
        for (importer, seen) in found.as_object().unwrap() {
            for (what, count) in counts.iter().chain(&extra) {
                if let Some(n) = seen.get(what) {
                    assert_eq!(n.as_u64(), Some(*count as u64), "{importer}: {what}");
                }
            }
            if let Some(m) = seen.get("mass") {
                assert!((m.as_f64().unwrap() / mass - 1.0).abs() < 1e-6, "{importer}: {m} kg of {mass} kg");
            }
            for joint in model.joints.iter().filter(|_| seen.get("limits").is_some()) {
                let l = &seen["limits"][&joint.name];
                let off = |k: usize, q: f64| (l[k].as_f64().unwrap() - q).abs();
                assert!(
                    off(0, joint.limit.lower) < 1e-6 && off(1, joint.limit.upper) < 1e-6,
                    "{importer}: {} {l}",
                    joint.name
                );
            }
        }
        assert!(found.as_object().unwrap().len() >= 8, "{found}");
    }
    Ok(())
}

/// urdfdom, which ROS reads URDFs with, has no other interface that says what it read.
fn urdfdom_counts_the_joints() -> Result<(), Missing> {
    venv::program("check_urdf", "--help", "liburdfdom-tools")?;
    for model in [chest(), lamp()] {
        let temp = tempfile::tempdir().unwrap();
        let urdf = written(&model, &temp).join(format!("{}.urdf", model.name));
        let output = Command::new("check_urdf").arg(urdf).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8_lossy(&output.stdout);
        // One line a link below the root.
        let links = text.lines().filter(|line| line.trim_start().starts_with("child(")).count();
        assert_eq!(links, model.joints.len(), "{text}");
    }
    Ok(())
}

fn a_chest_rests_opens_and_its_drawer_holds_a_ball() -> Result<(), Missing> {
    let python = venv::python()?;
    let (model, temp) = (chest(), tempfile::tempdir().unwrap());
    let folder = written(&model, &temp);
    let arguments = [folder.to_str().unwrap(), &model.name, "--ball", "joint_1"];
    let found = script(&python, "handoff_physics.py", &arguments);
    rests_and_opens(&model, &found);
    holds_the_ball(&found);
    Ok(())
}

fn a_lid_that_hangs_in_the_air_is_held_by_its_friction() -> Result<(), Missing> {
    let python = venv::python()?;
    let (model, temp) = (lamp(), tempfile::tempdir().unwrap());
    let folder = written(&model, &temp);
    let found = script(&python, "handoff_physics.py", &[folder.to_str().unwrap(), &model.name]);
    rests_and_opens(&model, &found);
    Ok(())
}

fn a_lid_on_a_thread_holds_turns_and_stays_on_it() -> Result<(), Missing> {
    let python = venv::python()?;
    let (model, temp) = (jar(), tempfile::tempdir().unwrap());
    let folder = written(&model, &temp);
    let arguments = [folder.to_str().unwrap(), &model.name];
    let found = script(&python, "handoff_physics.py", &arguments);
    rests_and_opens(&model, &found);
    // In MuJoCo the lid also keeps its height.
    assert!(found["mujoco"]["rest"]["joint_1_advance"].as_f64().unwrap() < 1e-5, "{found}");
    let found = script(&python, "handoff_screw.py", &arguments);
    for reader in ["mujoco mjcf", "mujoco urdf", "drake sdf", "drake urdf", "drake mjcf"] {
        let seen = &found[reader];
        let off = |what: &str| seen[what].as_f64().unwrap_or_else(|| panic!("{reader}: {found}"));
        // Drake's MJCF reader knows no equality: there the lid sinks, no further than the thread lets it.
        let most = if reader == "drake mjcf" { 2.4 * 0.012 + 1e-3 } else { 1e-4 };
        assert!(off("slip_m") < most, "{reader}: the lid leaves its thread by {} m", off("slip_m"));
        assert!(off("beyond_rad") < 0.02, "{reader}: {} rad beyond the limits", off("beyond_rad"));
    }
    Ok(())
}

fn scenes_and_ros_files_say_the_same_as_the_twin() -> Result<(), Missing> {
    let python = venv::python()?;
    for (model, settings) in [
        (chest(), serde_json::json!({})),
        (jar(), serde_json::json!({ "base": "floating", "prefix": "left_" })),
        (lamp(), serde_json::json!({ "prefix": "left_", "maintainer": "Ada <ada@example.org>" })),
    ] {
        let temp = tempfile::tempdir().unwrap();
        let config: ExportConfig = serde_json::from_value(settings.clone()).unwrap();
        let model = renamed_model(model, PartNames::Numbered, &config.prefix);
        let folder = checked(write_run_as(&model, &config, temp.path()));
        let arguments = [folder.to_str().unwrap(), &model.name];
        let found = script(&python, "handoff_scene.py", &arguments);
        let count = |what: &str| found[what].as_u64().unwrap();
        let floating = settings["base"] == "floating";
        let slides = model.joints.iter().filter(|j| j.kind.thread_m_per_rad().is_some()).count();
        assert_eq!(count("free_joints"), u64::from(floating), "{found}");
        assert_eq!(count("joints") as usize, model.joints.len() + slides, "{found}");
        assert_eq!(count("actuators") as usize, model.joints.len(), "{found}");
        // Two scenes, two robots by xacro: everything of the second has its own prefix.
        assert_eq!(count("expanded_links") as usize, model.links.len() + slides + 1, "{found}");
        assert_eq!(count("controlled_joints") as usize, model.joints.len() + slides, "{found}");
        assert_eq!(found["without_prefix"], serde_json::json!([]), "{found}");
        assert_eq!(found["missing"], serde_json::json!([]), "{found}");
        for joint in &model.joints {
            let held = found["held"][&joint.name].as_f64().unwrap();
            let reached = found["reached"][&joint.name].as_f64().unwrap();
            assert!(held < 0.03 && reached < 0.05, "{}: {found}", joint.name);
        }
    }
    Ok(())
}

/// The twin of a shipped recording.
fn reconstructed(name: &str, preset: &str, temp: &TempDir) -> PathBuf {
    let recording = Path::new(env!("CARGO_MANIFEST_DIR")).join("bags").join(name);
    let mut command = Command::new(env!("CARGO_BIN_EXE_artitwin"));
    let run = command
        .arg("reconstruct")
        .arg(recording)
        .args(["--preset", preset, "--out"])
        .arg(temp.path())
        .output()
        .unwrap();
    assert!(matches!(run.status.code(), Some(0 | 3)), "{}", String::from_utf8_lossy(&run.stderr));
    temp.path().join(name)
}

fn holds_the_ball(found: &serde_json::Value) {
    let ball = &found["ball"];
    assert!(ball["outside_m"].as_f64().unwrap() < 1e-6, "{ball}");
    assert!((ball["closed_to"].as_f64().unwrap() - ball["half"].as_f64().unwrap()).abs() < 0.01, "{ball}");
}

fn the_reconstructed_drawer_holds_a_ball() -> Result<(), Missing> {
    let python = venv::python()?;
    let temp = tempfile::tempdir().unwrap();
    let folder = reconstructed("drawer", "default", &temp);
    let arguments = [folder.to_str().unwrap(), "drawer", "--ball", "joint_1"];
    holds_the_ball(&script(&python, "handoff_physics.py", &arguments));
    Ok(())
}

fn the_reconstructed_laptop_looks_in_mujoco_as_in_the_photos() -> Result<(), Missing> {
    let python = venv::python()?;
    venv::drawing(&python, "libOSMesa.so.8", "libosmesa6")?;
    let temp = tempfile::tempdir().unwrap();
    let folder = reconstructed("laptop", "preview", &temp);
    let found = script(&python, "mujoco_pictures.py", &[folder.to_str().unwrap(), "laptop", "--add"]);
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.join("report.json")).unwrap()).unwrap();
    let (found, own) = (found.as_array().unwrap(), report["renderings"].as_array().unwrap());
    assert!(own.len() >= 3 && found.len() == own.len(), "{found:?}");
    for (theirs, ours) in found.iter().zip(own) {
        // The camera, the pose and the textures are right: MuJoCo filters textures and edges otherwise than
        // our rasterizer does.
        let (theirs, ours) = (theirs["psnr_db"].as_f64().unwrap(), ours["psnr_db"].as_f64().unwrap());
        assert!(theirs > 14.0 && theirs > ours - 4.5, "{theirs} dB in MuJoCo, {ours} dB here");
    }
    assert!(std::fs::read_to_string(folder.join("report.html")).unwrap().contains("In MuJoCo"));
    Ok(())
}

fn rests_and_opens(model: &ArticulatedModel, found: &serde_json::Value) {
    use model::JointKind;
    for simulator in ["mujoco", "pybullet"] {
        for joint in &model.joints {
            let drift = found[simulator]["rest"][&joint.name].as_f64().unwrap();
            let most = if joint.kind == JointKind::Revolute { 1e-3 } else { 5e-4 };
            assert!(drift < most, "{simulator}: {} drifts by {drift}", joint.name);
            let share = found[simulator]["open"][&joint.name].as_f64().unwrap();
            assert!(share > 0.95, "{simulator}: {} opens through {share} of its interval", joint.name);
        }
    }
}

fn limits_lie_between_what_was_seen_and_what_is_free() {
    let observed = chest_with(&ModelConfig { limits: LimitPolicy::Observed, ..ModelConfig::default() });
    let limit = &observed.joints[0].limit;
    let swept = limit.swept.unwrap();
    assert_eq!(([limit.lower, limit.upper], limit.source), ([0.0, 0.2], LimitSource::Observed));
    // The front stands before the boards: closed is closed. Open, nothing stops the drawer but its length.
    assert!((-0.005..=0.0).contains(&swept[0]) && (0.3..0.4).contains(&swept[1]), "{swept:?}");
    let free = chest_with(&ModelConfig { limits: LimitPolicy::Swept, ..ModelConfig::default() });
    let limit = &free.joints[0].limit;
    assert_eq!(([limit.lower, limit.upper], limit.source), (swept, LimitSource::Swept));
}

fn masses_follow_the_material_and_stay_in_their_range() {
    let wood = chest();
    let steel =
        ModelConfig { part_materials: vec![Material::Wood, Material::Steel], ..ModelConfig::default() };
    let mixed = chest_with(&steel);
    let mass = |m: &ArticulatedModel, l: usize| m.links[l].inertial.mass_kg;
    assert!((mass(&mixed, 0) / mass(&wood, 0) - 1.0).abs() < 1e-9);
    assert!((mass(&mixed, 1) / mass(&wood, 1) - 7850.0 / 600.0).abs() < 1e-6);
    // Boards of 2 cm and 1 cm: 2 * (0.4 * 0.02 * 0.3 + 0.4 * 0.4 * 0.02) + 0.02 * 0.4 * 0.26 and the
    // drawer's.
    for (l, volume) in [(0, 0.013_28), (1, 0.005_084)] {
        assert!(
            (mass(&wood, l) / (600.0 * volume) - 1.0).abs() < 0.15,
            "{l}: {} kg of {}",
            mass(&wood, l),
            600.0 * volume
        );
        let range = wood.links[l].inertial.mass_range_kg;
        // Both sides of nearly all boards are seen: what is left is the density of wood.
        let [low, high] = range.map(|m| m / mass(&wood, l));
        assert!((0.55..0.67).contains(&low) && (1.33..1.6).contains(&high), "{low} {high}");
    }
}

fn chromium() -> Result<(), Missing> {
    venv::program("chromium", "--version", "chromium")
}

fn everything_that_the_viewer_offers_does_something_and_fits_every_screen() -> Result<(), Missing> {
    chromium()?;
    let python = venv::python()?;
    let (model, temp) = (chest(), tempfile::tempdir().unwrap());
    let page = written(&model, &temp).join("viewer.html");
    let found = script(&python, "handoff_viewer.py", &[page.to_str().unwrap(), "joint_1"]);
    assert_eq!(
        (found["meshes"].as_u64(), found["errors"].as_array().map(Vec::len)),
        (Some(2), Some(0)),
        "{found}"
    );
    assert!(found["shown"].as_f64().unwrap() > 0.05, "{found}");
    for (step, share) in found["changed"].as_object().unwrap() {
        let share = share.as_f64().unwrap();
        // What was stopped stands still; all else changes the picture.
        let is_as_expected = if step == "paused" { share == 0.0 } else { share > 0.001 };
        assert!(is_as_expected, "{step}: {share} in {found}");
    }
    nothing_is_cut(&found);
    Ok(())
}

fn nothing_is_cut(found: &serde_json::Value) {
    let cut = found["cut"].as_object().unwrap();
    assert!(cut.len() >= 3 && cut.values().all(|c| c.as_array().is_some_and(Vec::is_empty)), "{found}");
    assert_eq!(found["errors"].as_array().map(Vec::len), Some(0), "{found}");
}

fn no_text_of_the_report_is_cut_on_any_screen() -> Result<(), Missing> {
    chromium()?;
    let python = venv::python()?;
    let temp = tempfile::tempdir().unwrap();
    let recording = Path::new(env!("CARGO_MANIFEST_DIR")).join("bags/drawer");
    let name = format!("n{}", "ame_without_end".repeat(4));
    let mut request = ReconstructRequest::new([recording], temp.path());
    request.name = Some(name.clone());
    request.config.export.prefix = "a_cell_with_many_robots_".into();
    reconstruct(&request, &Monitor::silent()).unwrap();
    let page = temp.path().join(&name).join("report.html");
    let found = script(&python, "handoff_report.py", &[page.to_str().unwrap()]);
    nothing_is_cut(&found);
    Ok(())
}
