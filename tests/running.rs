//! A run as a process: stopped and continued, told as JSON, started from the identity.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]
#![cfg(unix)]

mod common;
#[path = "common/program.rs"]
mod program;

use std::{
    collections::BTreeSet,
    io::{BufRead as _, BufReader},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::OnceLock,
};

use common::TempDir;
use program::{Ended, end, reconstruct, shipped};
use serde_json::Value;

/// Files that must come out the same.
const FILES: [&str; 3] = ["drawer.urdf", "meshes/visual/base.obj", "meshes/visual/part_1.obj"];

/// `bags/drawer` with all stages, and events as JSON.
fn drawer(out: &Path, options: &[&str]) -> Command {
    let all = ["--parts", "2", "--json", "--set", "surface.source=field", "--set", "articulation.refine=true"];
    reconstruct(&[&shipped("drawer")], out, &[&all, options].concat())
}

fn events(stdout: &str) -> Vec<Value> {
    stdout.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"))).collect()
}

fn files(out: &Path) -> Vec<Vec<u8>> {
    FILES.iter().map(|file| std::fs::read(out.join("drawer").join(file)).unwrap()).collect()
}

/// Events and files of a run that nothing interrupts.
fn uninterrupted() -> &'static (Vec<Value>, Vec<Vec<u8>>) {
    static RUN: OnceLock<(Vec<Value>, Vec<Vec<u8>>)> = OnceLock::new();
    RUN.get_or_init(|| {
        let folder = TempDir::new("uninterrupted");
        let ended = end(&mut drawer(&folder.join("runs"), &[]));
        assert!([0, 3].contains(&ended.code), "{}", ended.stderr);
        (events(&ended.stdout), files(&folder.join("runs")))
    })
}

/// Starts a run and sends it a signal at the first step of a stage.
fn stopped_in(stage: &str, signal: &str, out: &Path) -> Ended {
    let mut child = drawer(out, &[]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut stdout = String::new();
    let mut asked = false;
    for line in BufReader::new(child.stdout.take().unwrap()).lines() {
        let line = line.unwrap();
        let event: Value = serde_json::from_str(&line).unwrap();
        stdout += &(line + "\n");
        if !asked && event["event"] == "step" && event["stage"] == stage {
            let sent = Command::new("kill").args(["-s", signal, &child.id().to_string()]).status().unwrap();
            asked = sent.success();
        }
    }
    let rest = child.wait_with_output().unwrap();
    Ended { code: rest.status.code().unwrap(), stdout, stderr: String::from_utf8(rest.stderr).unwrap() }
}

fn checkpoint(out: &Path) -> PathBuf {
    out.join(".artitwin-drawer.checkpoint")
}

/// Steps that a stage told.
fn steps(events: &[Value], stage: &str) -> Vec<u64> {
    events.iter().filter(|e| e["event"] == "step" && e["stage"] == stage).map(|e| e["done"].as_u64().unwrap()).collect()
}

/// Stops a run in a stage, lets `change` loose on its checkpoint, continues it: the same files must come out. Gives the
/// events of the continued run.
fn stopped_and_continued(stage: &str, signal: &str, change: impl FnOnce(&Path)) -> Vec<Value> {
    let folder = TempDir::new(&format!("stopped-{}-{signal}", stage.replace('/', "-")));
    let out = folder.join("runs");
    let stopped = stopped_in(stage, signal, &out);
    assert_eq!(stopped.code, 130, "{}", stopped.stderr);
    assert!(stopped.stderr.contains("continue with --resume"), "{}", stopped.stderr);
    assert!(!out.join("drawer").exists() && checkpoint(&out).is_dir());
    let told = steps(&events(&stopped.stdout), stage);
    assert!(told.len() < steps(&uninterrupted().0, stage).len(), "the stage ended before the signal came");
    change(&checkpoint(&out));
    let continued = end(&mut drawer(&out, &["--resume"]));
    assert!([0, 3].contains(&continued.code), "{}", continued.stderr);
    for (file, (a, b)) in FILES.iter().zip(files(&out).iter().zip(&uninterrupted().1)) {
        assert!(a == b, "{file} differs from that of an uninterrupted run");
    }
    assert!(!checkpoint(&out).exists());
    events(&continued.stdout)
}

#[test]
fn a_run_stopped_in_stage_1_ends_as_if_it_had_not_been() {
    let events = stopped_and_continued("field/state0", "INT", |_| {});
    let first = |events: &[Value]| steps(events, "field/state0")[0];
    assert!(first(&events) > first(&uninterrupted().0), "it did not continue");
}

#[test]
fn a_run_stopped_in_stage_2_ends_as_if_it_had_not_been() {
    let events = stopped_and_continued("articulate", "TERM", |_| {});
    assert!(steps(&events, "field/state0").is_empty() && steps(&events, "field/state1").is_empty(), "fields were trained again");
    assert!(steps(&events, "articulate")[0] > 1, "it did not continue");
}

#[test]
fn a_damaged_checkpoint_counts_as_absent() {
    let damage = |folder: &Path| {
        let file = folder.join("field-state1.ckpt");
        let mut bytes = std::fs::read(&file).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(&file, bytes).unwrap();
    };
    let events = stopped_and_continued("articulate", "INT", damage);
    let told = |e: &&Value| e["event"] == "warning" && e["message"].as_str().unwrap().contains("field-state1.ckpt cannot be used");
    assert_eq!(events.iter().filter(told).count(), 1);
    assert!(steps(&events, "field/state0").is_empty() && !steps(&events, "field/state1").is_empty());
}

#[test]
fn continuing_without_a_checkpoint_starts_anew_and_says_so() {
    let folder = TempDir::new("no-checkpoint");
    let ended = end(&mut drawer(&folder.join("runs"), &["--resume"]));
    assert!([0, 3].contains(&ended.code), "{}", ended.stderr);
    let told = |e: &Value| e["event"] == "note" && e["message"].as_str().unwrap().contains("no usable checkpoint of drawer in ");
    assert!(events(&ended.stdout).iter().any(told), "{}", ended.stdout);
    assert_eq!(files(&folder.join("runs")), uninterrupted().1);
}

#[test]
fn continuing_another_run_is_refused_and_its_checkpoint_kept() {
    let folder = TempDir::new("other-run");
    let out = folder.join("runs");
    assert_eq!(stopped_in("field/state0", "INT", &out).code, 130);
    let ended = end(&mut drawer(&out, &["--resume", "--set", "train.steps=121"]));
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    for word in ["belongs to another run", "config.train.steps is 121, was 120", "without --resume"] {
        assert!(ended.stderr.contains(word), "`{word}` is not in {}", ended.stderr);
    }
    assert!(checkpoint(&out).join("field-state0.ckpt").is_file() && !out.join("drawer").exists());
}

/// Names of an event's fields.
fn fields(event: &Value) -> BTreeSet<&str> {
    event.as_object().unwrap().keys().map(String::as_str).collect()
}

#[test]
fn events_are_as_documented() {
    let events = &uninterrupted().0;
    for event in events {
        let known: &[&str] = match event["event"].as_str().unwrap() {
            "stage_started" => &["event", "stage", "steps"],
            "step" => &["event", "stage", "done", "total", "loss"],
            "stage_finished" => &["event", "stage", "seconds"],
            "warning" | "note" => &["event", "message"],
            "artifact" => &["event", "path"],
            other => panic!("{other} is not documented"),
        };
        assert_eq!(fields(event), known.iter().copied().collect(), "{event}");
    }
    let stages = |kind: &str| events.iter().filter(|e| e["event"] == kind).map(|e| e["stage"].as_str().unwrap()).collect::<Vec<_>>();
    assert_eq!(stages("stage_started"), stages("stage_finished"));
    for stage in ["capture", "match", "field/state0", "field/state1", "register", "articulate", "joints", "assemble", "pictures"] {
        assert!(stages("stage_started").contains(&stage), "{stage}");
    }
    for stage in ["field/state0", "field/state1", "articulate"] {
        let done = steps(events, stage);
        let total = events.iter().find(|e| e["event"] == "stage_started" && e["stage"] == stage).unwrap()["steps"].as_u64().unwrap();
        assert!(done.windows(2).all(|w| w[0] < w[1]) && done.last() == Some(&total), "{stage}: {done:?} of {total}");
    }
    let artifacts: Vec<_> = events.iter().filter(|e| e["event"] == "artifact").collect();
    assert!(artifacts.len() == 1 && events.last() == artifacts.first().copied());
    assert!(artifacts[0]["path"].as_str().unwrap().ends_with("runs/drawer"));
}

#[test]
fn a_failure_is_the_last_event() {
    let folder = TempDir::new("json-error");
    let out = folder.join("runs");
    let run = |options: &[&str]| end(&mut reconstruct(&[&shipped("drawer/state0")], &out, &[&["--json"], options].concat()));
    for (options, code, word) in [(&["--parts", "2"][..], 1, "two states are needed"), (&["--parts", "1"], 2, "run.parts")] {
        let ended = run(options);
        assert_eq!(ended.code, code, "{}", ended.stderr);
        let events = events(&ended.stdout);
        let last = events.last().unwrap();
        assert_eq!(fields(last), ["event", "message", "exit_code"].into_iter().collect());
        assert_eq!((&last["event"], last["exit_code"].as_i64()), (&"error".into(), Some(i64::from(code))));
        assert!(last["message"].as_str().unwrap().contains(word), "{last}");
        // For people the same on stderr.
        assert_eq!(ended.stderr, format!("error: {}\n", last["message"].as_str().unwrap()));
    }
}

#[test]
fn from_the_identity_both_starts_are_reported() {
    let folder = TempDir::new("identity");
    let out = folder.join("runs");
    let ended = end(&mut drawer(&out, &["--init", "identity", "--set", "articulation.identity_steps=60"]));
    assert!([0, 3].contains(&ended.code), "{}", ended.stderr);
    let report: Value = serde_json::from_slice(&std::fs::read(out.join("drawer/report.json")).unwrap()).unwrap();
    let truth: Value = serde_json::from_slice(&std::fs::read(shipped("drawer/truth.json")).unwrap()).unwrap();
    let [identity, registration] = report["initialization"].as_array().unwrap().as_slice() else { panic!("{}", report["initialization"]) };
    assert_eq!((&identity["source"], &identity["used"]), (&"identity".into(), &true.into()));
    assert_eq!(identity["start_displacement_mm"], 0.0);
    assert_eq!((&registration["source"], &registration["used"]), (&"registration".into(), &false.into()));
    let slid_mm = 1000.0 * truth["parts"][1]["motion"].as_f64().unwrap().abs();
    let alone_mm = registration["start_displacement_mm"].as_f64().unwrap();
    assert!((alone_mm - slid_mm).abs() < 10.0, "registration alone: {alone_mm} mm, truth {slid_mm} mm");
    let html = std::fs::read_to_string(out.join("drawer/report.html")).unwrap();
    assert!(html.contains("not used: registration"));
}
