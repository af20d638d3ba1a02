//! `artitwin diagnose` on a twin in a run folder: the effects in the SDF and the USD that stand beside it.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stderr, reason = "a test may panic")]

mod common;
#[path = "common/door.rs"]
mod door;
#[path = "common/harness.rs"]
mod harness;
#[path = "common/program.rs"]
mod program;
#[path = "common/venv.rs"]
mod venv;

use std::{
    path::Path,
    process::{Command, ExitCode},
};

use common::{BagWriter, START};
use door::{DAMPING, INERTIAL, door, twin};
use harness::{Missing, tests};
use io::ros2msg::{Header, JointState, Time};
use program::end;
use tempfile::TempDir;

fn main() -> ExitCode {
    harness::main(tests![
        sdf_and_usd_beside_the_twin_get_its_effects,
        usd_core_reads_the_effects,
        without_them_the_report_says_so,
        of_a_class_the_member_that_a_format_holds_is_written,
        the_page_shows_what_was_found_and_what_is_proven,
    ])
}

/// Damping that the twin does not know of, N m s/rad.
const HIDDEN: f64 = 0.5;

const SDF: &str = "<sdf version=\"1.9\"><model name=\"twin\"><link name=\"base\"/><link name=\"door\"/>\
    <joint name=\"door_joint\" type=\"revolute\"><parent>base</parent><child>door</child>\
    <axis><xyz>0 0 1</xyz><limit><lower>-1</lower><upper>3</upper></limit>\
    <dynamics><damping>0.4</damping><friction>0</friction></dynamics></axis></joint></model></sdf>";

const USD: &str = "#usda 1.0\n\
    (\n    defaultPrim = \"twin\"\n)\n\n\
    def Xform \"twin\"\n{\n    \
    def Xform \"base\"\n    {\n    }\n    \
    def Xform \"door\"\n    {\n    }\n    \
    def Scope \"Joints\"\n    {\n        \
    def PhysicsRevoluteJoint \"door_joint\" (\n            \
    prepend apiSchemas = [\"PhysicsDriveAPI:angular\", \"PhysxJointAxisAPI:angular\", \
    \"NewtonJointAPI\"]\n        )\n        {\n            \
    rel physics:body0 = </twin/base>\n            rel physics:body1 = </twin/door>\n            \
    float physics:lowerLimit = -57.29578\n            \
    float physxJointAxis:angular:viscousFrictionCoefficient = 0.00698\n            \
    float newton:damping = 0.00698\n        }\n    }\n}\n";

/// Diagnoses the door by recordings whose positions are off by a factor.
fn diagnose(folder: &TempDir, scale: f64, options: &[&str]) -> (serde_json::Value, String) {
    let twin = twin(folder, INERTIAL);
    let write = |run: usize| {
        let path = folder.path().join(format!("run_{run}.mcap"));
        let mut bag = BagWriter::create(&path, None, 100_000);
        for s in door(run, 10.0, 0.0, DAMPING + HIDDEN) {
            let nanos = START + (s.time_s * 1e9).round() as i64;
            let header = Header { stamp: Time::from_nanos(nanos), frame_id: String::new() };
            let name = vec!["door_joint".to_owned()];
            let position = s.position.iter().map(|q| scale * q).collect();
            let state = JointState { header, name, position, velocity: Vec::new(), effort: s.effort };
            bag.message("/joint_states", "sensor_msgs/msg/JointState", nanos, &state);
        }
        bag.finish();
        path
    };
    let runs: Vec<_> = (0..3).map(write).collect();
    let out = folder.path().join("out");
    let ended = end(Command::new(env!("CARGO_BIN_EXE_artitwin"))
        .arg("diagnose")
        .arg(twin)
        .args(runs)
        .args(options)
        .arg("--out")
        .arg(&out));
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    (serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap(), ended.stderr)
}

fn status(report: &serde_json::Value, format: &str) -> String {
    let exports = report["exports"].as_array().unwrap();
    let own: Vec<_> = exports.iter().filter(|e| e["format"] == format).collect();
    assert_eq!(own.len(), 1, "{report:#}");
    own[0]["status"].as_str().unwrap().to_owned()
}

/// An attribute of the door's joint as usd-core reads it.
fn read_usd(python: &Path, path: &Path, attribute: &str) -> f64 {
    let code = "import sys\nfrom pxr import Usd, UsdPhysics\nstage = Usd.Stage.Open(sys.argv[1])\n\
                prim = stage.GetPrimAtPath('/twin/Joints/door_joint')\n\
                assert UsdPhysics.RevoluteJoint(prim)\nprint(prim.GetAttribute(sys.argv[2]).Get())";
    let output = Command::new(python).args(["-c", code]).arg(path).arg(attribute).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).trim().parse().unwrap()
}

fn sdf_and_usd_beside_the_twin_get_its_effects() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("model.sdf"), SDF).unwrap();
    std::fs::write(folder.path().join("twin.usda"), USD).unwrap();
    let (report, stderr) = diagnose(&folder, 1.0, &[]);
    assert!(!stderr.contains("holds less"), "{stderr}");
    let damping = DAMPING + report["findings"][0]["parameters"][0]["value"].as_f64().unwrap();
    assert!((damping - DAMPING - HIDDEN).abs() < 0.05, "{report:#}");
    assert_eq!([status(&report, "sdf"), status(&report, "usd")], ["native", "native"]);
    let rmse = |format: &str| {
        report["exports"].as_array().unwrap().iter().find(|e| e["format"] == format).unwrap()["rmse"].as_f64()
    };
    assert_eq!(rmse("sdf"), report["gap"]["after"].as_f64());
    for export in report["exports"].as_array().unwrap() {
        assert_eq!((&export["before"], &export["by"]), (&report["gap"]["before"], &serde_json::json!([])));
    }
    let text = std::fs::read_to_string(folder.path().join("out").join("model.sdf")).unwrap();
    let document = roxmltree::Document::parse(&text).unwrap();
    let told = document.descendants().find(|n| n.has_tag_name("damping")).unwrap().text().unwrap();
    assert!((told.parse::<f64>().unwrap() - damping).abs() < 1e-9, "{told}");
    let usd = folder.path().join("out").join("twin.usda");
    let text = std::fs::read_to_string(&usd).unwrap();
    assert!(text.contains("float physics:lowerLimit = -57.29578"), "{text}");
}

fn usd_core_reads_the_effects() -> Result<(), Missing> {
    let python = venv::python()?;
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("twin.usda"), USD).unwrap();
    let (report, _) = diagnose(&folder, 1.0, &[]);
    let damping = DAMPING + report["findings"][0]["parameters"][0]["value"].as_f64().unwrap();
    for attribute in ["newton:damping", "physxJointAxis:angular:viscousFrictionCoefficient"] {
        let value = read_usd(&python, &folder.path().join("out/twin.usda"), attribute);
        assert!((value - damping.to_radians()).abs() < 1e-6, "{attribute} {value}");
    }
    Ok(())
}

fn without_them_the_report_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let (report, _) = diagnose(&folder, 1.0, &[]);
    assert_eq!(status(&report, "urdf"), "native");
    assert!(status(&report, "sdf").contains("no model.sdf"), "{report:#}");
    assert!(status(&report, "usd").contains("not written"), "{report:#}");
    assert!(!folder.path().join("out").join("model.sdf").exists());
}

fn of_a_class_the_member_that_a_format_holds_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let effects = "viscous_friction,encoder_scale";
    let (report, stderr) = diagnose(&folder, 1.2, &["--effects", effects]);
    let export = |format: &str| {
        let exports = report["exports"].as_array().unwrap();
        let is_it = |e: &&serde_json::Value| e["format"] == format && e["effect"] == "encoder_scale";
        exports.iter().find(is_it).unwrap().clone()
    };
    let mjcf = export("mjcf");
    assert_eq!(mjcf["status"], "replaced", "{report:#}");
    assert_eq!(mjcf["by"][0]["effect"], "torque_gain", "{report:#}");
    let gain = mjcf["by"][0]["parameters"][0]["value"].as_f64().unwrap();
    assert!((gain - 1.2).abs() < 0.02, "{report:#}");
    let [left, after, before] =
        [&mjcf["rmse"], &report["gap"]["after"], &mjcf["before"]].map(|x| x.as_f64().unwrap());
    assert!(left < 1.1 * after && after < 0.5 * before, "{report:#}");
    // The file has the number of the report.
    let text = std::fs::read_to_string(folder.path().join("out").join("twin.xml")).unwrap();
    assert!(text.contains(&format!("gear=\"{gain}\"")), "{text}");
    // URDF has no gain; the damping is better than nothing, and what was found is an element.
    assert_eq!(export("urdf")["status"], "not expressible", "{report:#}");
    assert!(export("urdf")["rmse"].as_f64().unwrap() < before, "{report:#}");
    assert!(stderr.contains("twin.urdf holds less than was found at joint 'door_joint'"), "{stderr}");
    let text = std::fs::read_to_string(folder.path().join("out").join("twin.urdf")).unwrap();
    assert!(text.contains("<gap:effect name=\"encoder_scale\" status=\"not expressible\">"), "{text}");
}

fn the_page_shows_what_was_found_and_what_is_proven() {
    let folder = tempfile::tempdir().unwrap();
    let (report, _) = diagnose(&folder, 1.0, &[]);
    let page = std::fs::read_to_string(folder.path().join("out/report.html")).unwrap();
    let found = &report["findings"][0];
    assert_eq!(found["effect"], "viscous_friction", "{report:#}");
    // The twin damps by 0.4, and nothing less than the sum of both is what the joint has.
    let value = found["parameters"][0]["value"].as_f64().unwrap();
    let sums = [1, 2, 3, 4].map(|places| {
        let [twin, found, sum] = [DAMPING, value, DAMPING + value].map(|x| format!("{x:.places$}"));
        format!("viscous friction {twin} + {found} = {sum}\u{a0}N\u{a0}m\u{a0}s/rad")
    });
    assert!(sums.iter().any(|s| page.contains(s.as_str())), "{sums:?}");
    for part in [
        "Next experiment:</b> To know viscous friction",
        "viscous friction: effort against velocity",
        "door turns on base",
        "Gap on held-out runs",
        "held out: run_2",
        "Held-out run run_2",
        "What each file holds",
        "twin.urdf",
    ] {
        assert!(page.contains(part), "'{part}' is not in the page");
    }
    // The windows of the proof are shaded, in the charts of positions and of residuals.
    let windows: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("out/replay.json")).unwrap()).unwrap();
    assert_eq!(page.matches("class=\"window\"").count(), 2 * windows.as_array().unwrap().len());
    for loaded in ["http:", "https:", "<script", "<link", "url(", "src="] {
        assert!(!page.contains(loaded), "{loaded}");
    }
    assert!(page.len() < 1_000_000, "{} bytes", page.len());
}
