//! The main job twice on a recording that ships here. How accurate twins are is measured in `accuracy.rs`.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use export::{Level, check_folder};
use io::read_model_folder;

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
fn the_same_seed_gives_the_same_files() {
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
}
