//! The fleet (`python/artitwin/fleet`): its parts, jobs on stores that fail, every way in which a job or
//! worker can end with a program that does as it is asked to, and six small recordings on two raylets of
//! Ray, of which one is killed. Needs Python (see `common/venv.rs`).

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "a test may panic, and says how long it took")]

#[path = "common/harness.rs"]
mod harness;
#[path = "common/venv.rs"]
mod venv;

use std::{
    path::{Path, PathBuf},
    process::{Command, ExitCode},
    sync::Mutex,
};

use harness::{Missing, tests};

fn main() -> ExitCode {
    harness::main(tests![
        parts_without_a_cluster,
        stores_that_fail_change_and_lie,
        jobs_of_the_program_on_stores,
        every_way_to_end,
        recordings_on_raylets_that_are_killed,
    ])
}

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
/// A cluster at a time: they would share the cores, and a test of kills rests on when things happen.
static CLUSTER: Mutex<()> = Mutex::new(());

/// An empty folder of these tests.
fn folder(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("fleet").join(name);
    std::fs::remove_dir_all(&path).ok();
    std::fs::create_dir_all(&path).unwrap();
    path
}

/// Runs a script of `tests/python/fleet` with the package as it stands in the source.
fn run(script: &str, arguments: &[&Path]) -> Result<(), Missing> {
    let python = venv::python()?;
    let mut command = Command::new(python);
    command.arg(Path::new(ROOT).join("tests/python/fleet").join(script)).args(arguments);
    command.env("PYTHONPATH", Path::new(ROOT).join("python")).env("RAY_USAGE_STATS_ENABLED", "0");
    for name in ["ARTITWIN_PROGRAM", "AWS_PROFILE", "FAKE_LOG", "RAY_ADDRESS"] {
        command.env_remove(name);
    }
    let output = command.output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(output.status.success(), "{script}: {}{}", text(&output.stdout), text(&output.stderr));
    eprint!("{}", text(&output.stdout));
    Ok(())
}

fn parts_without_a_cluster() -> Result<(), Missing> {
    run("units.py", &[&folder("units")])
}

fn stores_that_fail_change_and_lie() -> Result<(), Missing> {
    run("stores.py", &[&folder("stores")])
}

fn jobs_of_the_program_on_stores() -> Result<(), Missing> {
    run("jobs.py", &[Path::new(env!("CARGO_BIN_EXE_artitwin")), &folder("jobs")])
}

fn every_way_to_end() -> Result<(), Missing> {
    let _guard = CLUSTER.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    run("faults.py", &[&folder("faults")])
}

fn recordings_on_raylets_that_are_killed() -> Result<(), Missing> {
    let _guard = CLUSTER.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    run("cluster.py", &[Path::new(env!("CARGO_BIN_EXE_artitwin")), &folder("cluster")])
}
