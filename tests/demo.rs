//! `artitwin demo`: a drawer that was reconstructed is opened and closed by contact, and keeps a ball.
//!
//! Needs Python with MuJoCo (see `common/venv.rs`), and EGL for the film.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stderr, reason = "a test may panic")]

#[path = "common/harness.rs"]
mod harness;
#[path = "common/venv.rs"]
mod venv;

use std::{
    path::{Path, PathBuf},
    process::{Command, ExitCode, Output},
    sync::OnceLock,
};

use harness::{Missing, tests};

fn main() -> ExitCode {
    harness::main(tests![
        a_hand_opens_and_closes_the_drawer_and_the_ball_stays,
        an_arm_does_it_too,
        a_motion_is_made_of_as_many_holds_as_it_needs,
        nothing_but_contact_moves_the_twin,
        #[cfg(unix)]
        a_python_without_packages_says_what_to_install,
    ])
}

/// A folder for all tests of this file, and in it the twin of a shipped recording.
fn twin() -> &'static Path {
    static FOUND: OnceLock<PathBuf> = OnceLock::new();
    FOUND.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("demo");
        std::fs::remove_dir_all(&folder).ok();
        // A made drawer with a bar. The shipped one, recorded with more noise, a hand opens, too, but an arm
        // finds room for its hold in some twins only.
        let bag = folder.join("bag");
        let mut synth = artitwin();
        synth.args(["synth", "--seed", "501", "--family", "cabinet", "--handles", "bar", "--parts", "2"]);
        let made = synth.arg("--out").arg(&bag).output().unwrap();
        assert!(made.status.success(), "{}", said(&made));
        let mut command = artitwin();
        command.args(["reconstruct", "--name", "drawer", "--out"]).arg(&folder);
        let output = command.args(["state0", "state1"].map(|s| bag.join(s))).output().unwrap();
        assert!(matches!(output.status.code(), Some(0 | 3)), "{}", said(&output));
        folder.join("drawer")
    })
}

fn artitwin() -> Command {
    Command::new(env!("CARGO_BIN_EXE_artitwin"))
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Gives the demonstration and its folder.
fn demo(name: &str, python: &Path, options: &[&str]) -> (Output, PathBuf) {
    let out = twin().with_file_name(name);
    let mut command = artitwin();
    command.arg("demo").arg(twin()).arg("--python").arg(python).args(options).arg("--out").arg(&out);
    (command.output().unwrap(), out)
}

/// Every joint was opened and closed, and the drawer kept its ball.
fn succeeded(folder: &Path, robot: &str) {
    let text = std::fs::read_to_string(folder.join("demo.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(report["robot"], robot);
    let [joint] = report["joints"].as_array().unwrap().as_slice() else { panic!("{text}") };
    let share = |way: &str| joint[way]["share"].as_f64().unwrap();
    assert!(share("open") > 0.95 && share("close").abs() < 0.05, "{text}");
    assert_eq!((&joint["ball"]["stayed"], &joint["success"]), (&true.into(), &true.into()), "{text}");
    let truth = std::fs::read_to_string(twin().with_file_name("bag").join("truth.json")).unwrap();
    let truth: serde_json::Value = serde_json::from_str(&truth).unwrap();
    let (handle, part) = (&truth["handles"][0], &truth["parts"][1]);
    let number = |v: &serde_json::Value| v.as_f64().unwrap();
    // From the bar's middle where the drawer is closed; its frame is that of state 0.
    let off = |k: usize| {
        let closed = number(&handle["frame"][k][3]) - number(&part["q0"]) * number(&part["axis"][k]);
        number(&joint["open"]["legs"][0]["tip_m"][k]) - closed
    };
    let off_m = (0..3).map(off).map(|d| d * d).sum::<f64>().sqrt();
    assert!(off_m < 0.5 * number(&handle["size"]["length_m"]) + 0.01, "held {off_m} m off the bar: {text}");
}

fn a_hand_opens_and_closes_the_drawer_and_the_ball_stays() -> Result<(), Missing> {
    let python = venv::python()?;
    venv::drawing(&python, "libEGL.so.1", "libegl1")?;
    let (output, folder) = demo("hand", &python, &[]);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let table = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(table.contains("1 of 1 joints opened and closed by contact"), "{table}");
    succeeded(&folder, "gripper");
    let gif = std::fs::read(folder.join("demo.gif")).unwrap();
    let frames =
        gif.windows(4).filter(|w| *w == [0x21, 0xf9, 0x04, 0x04] || *w == [0x21, 0xf9, 0x04, 0x00]).count();
    assert!(gif.starts_with(b"GIF89a") && frames > 20, "{frames} frames");
    assert!(folder.join("manifest.json").exists());
    // The same again takes its place; the twin itself is never replaced.
    let mut over = artitwin();
    let refused = over.arg("demo").arg(twin()).arg("--out").arg(twin()).output().unwrap();
    assert!(refused.status.code() == Some(1) && said(&refused).contains("the input"), "{}", said(&refused));
    Ok(())
}

fn an_arm_does_it_too() -> Result<(), Missing> {
    let python = venv::python()?;
    let (output, folder) = demo("arm", &python, &["--robot", "panda", "--no-film"]);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    succeeded(&folder, "panda");
    assert!(!folder.join("demo.gif").exists());
    Ok(())
}

fn a_motion_is_made_of_as_many_holds_as_it_needs() -> Result<(), Missing> {
    let python = venv::python()?;
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut command = Command::new(python);
    command.arg(root.join("tests/python/demo_moves.py")).arg(root.join("src/run/demonstrate"));
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    Ok(())
}

fn nothing_but_contact_moves_the_twin() -> Result<(), Missing> {
    let python = venv::python()?;
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut command = Command::new(python);
    command.arg(root.join("tests/python/demo_control.py")).arg(root.join("src/run/demonstrate")).arg(twin());
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let number = |key: &str| found[key].as_f64().unwrap();
    assert!(number("touching") > 0.95 && number("ghost").abs() < 1e-3, "{found}");
    assert_eq!((number("driven"), number("welds")), (0.0, 0.0), "{found}");
    Ok(())
}

#[cfg(unix)]
fn a_python_without_packages_says_what_to_install() -> Result<(), Missing> {
    use std::os::unix::fs::PermissionsExt as _;
    venv::program("python3", "--version", "python3")?;
    let python = twin().with_file_name("bare-python");
    // -S: without the folder that packages are installed to.
    std::fs::write(&python, "#!/bin/sh\nexec python3 -S \"$@\"\n").unwrap();
    std::fs::set_permissions(&python, std::fs::Permissions::from_mode(0o755)).unwrap();
    let (output, folder) = demo("bare", &python, &[]);
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("pip install mujoco numpy pillow"), "{}", said(&output));
    assert!(!folder.exists());
    Ok(())
}
