//! The main job on a recording that ships here.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use artitwin::internal::{
    evaluate::{EvaluateOptions, run},
    export::{Level, check_folder},
    io::read_model_folder,
};

fn reconstruct(out: &Path, options: &[&str]) -> (i32, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_artitwin"))
        .args(["reconstruct", "bags/drawer", "--preset", "preview", "--out"])
        .arg(out)
        .args(options)
        .output()
        .unwrap();
    (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
}

fn folder(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::remove_dir_all(&folder).ok();
    folder
}

#[test]
fn the_drawer_slides_and_the_same_seed_gives_the_same_files() {
    let outs = [folder("reconstruct-a"), folder("reconstruct-b")];
    for out in &outs {
        let (code, told) = reconstruct(out, &["--parts", "2"]);
        assert!(code == 0 || code == 3, "{told}");
    }
    let read = |out: &PathBuf, file: &str| std::fs::read(out.join("drawer").join(file)).unwrap();
    let same = [
        "drawer.urdf",
        "drawer.xml",
        "drawer.usda",
        "meshes/visual/base.obj",
        "meshes/visual/part_1.png",
        "meshes/collision/base_solid_0.obj",
    ];
    for file in same {
        assert_eq!(
            read(&outs[0], file),
            read(&outs[1], file),
            "{file} differs between two runs with one seed"
        );
    }
    let found = check_folder(&read_model_folder(&outs[0].join("drawer")).unwrap());
    assert!(found.iter().all(|f| f.level != Level::Error), "{found:?}");
    let report =
        run(&[outs[0].join("drawer")], Path::new("bags/drawer"), &EvaluateOptions::default()).unwrap();
    let joint = &report.trials[0].joints[0];
    assert_eq!(joint.type_right, Some(true), "{joint:?}");
    assert!(joint.error_mm.is_some_and(|e| e < 5.0), "{joint:?}");
}

#[test]
fn a_measured_recording_in_which_nothing_moved_is_one_part() {
    let out = folder("reconstruct-real-box");
    let output = Command::new(env!("CARGO_BIN_EXE_artitwin"))
        .args(["reconstruct", "bags/real_box", "--out"])
        .arg(&out)
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(3), "{}", String::from_utf8_lossy(&output.stderr));
    let report = std::fs::read_to_string(out.join("real_box/report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    assert_eq!((&report["part_count"]["found"], &report["joints"]), (&1.into(), &serde_json::json!([])));
    // Shreds of its surface are left, which is said of both states.
    let codes: Vec<_> = report["warnings"].as_array().unwrap().iter().map(|w| &w["code"]).collect();
    assert_eq!(codes, ["twin_differs"; 2]);
}
