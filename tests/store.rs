//! Jobs: results under keys in a folder and in an object store, done once and whole.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]
#![allow(clippy::print_stderr, reason = "says what is left out")]

mod common;
#[path = "common/harness.rs"]
mod harness;
#[path = "common/program.rs"]
mod program;
#[path = "common/venv.rs"]
mod venv;

use std::{
    collections::BTreeMap,
    fs,
    io::{BufRead as _, BufReader, Read as _, Write as _},
    net::TcpStream,
    path::{Path, PathBuf},
    process::{Child, Command, ExitCode, Stdio},
    time::{Duration, Instant},
};

use common::{BagWriter, TempDir};
use harness::{Missing, tests};
use program::{Ended, end, reconstruct, shipped};
use serde_json::Value;

fn main() -> ExitCode {
    harness::main(tests![
        a_job_is_done_once_and_as_the_plain_command_does_it,
        a_job_with_another_setting_takes_the_stages_that_stand,
        a_refusal_is_kept_with_its_reason_and_not_met_again,
        #[cfg(unix)]
        a_job_that_was_killed_is_done_by_the_next,
        #[cfg(unix)]
        a_command_of_another_package_is_run_and_an_unknown_one_refused,
        an_object_store_that_refuses_some_requests_gives_and_gets_the_same_bytes,
    ])
}

/// Files of a result that hold times or digests of such.
const WITH_TIMES: [&str; 3] = ["report.json", "report.html", "manifest.json"];

/// Files below a folder, without those that hold times.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let (mut found, mut open) = (BTreeMap::new(), vec![folder.to_owned()]);
    while let Some(path) = open.pop() {
        for entry in fs::read_dir(path).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else {
                let name = path.strip_prefix(folder).unwrap().to_str().unwrap().to_owned();
                found.insert(name, fs::read(path).unwrap());
            }
        }
    }
    found.retain(|name, _| !WITH_TIMES.contains(&name.as_str()));
    found
}

/// The only manifest of a store in a folder.
fn manifest(out: &Path) -> Value {
    let paths: Vec<PathBuf> = fs::read_dir(out).unwrap().map(|e| e.unwrap().path()).collect();
    let manifests: Vec<&PathBuf> =
        paths.iter().filter(|p| p.extension().is_some_and(|e| e == "json")).collect();
    assert_eq!(manifests.len(), 1, "{paths:?}");
    serde_json::from_slice(&fs::read(manifests[0]).unwrap()).unwrap()
}

fn uri(path: &Path) -> PathBuf {
    format!("file://{}", path.display()).into()
}

fn is_whole(out: &Path, manifest: &Value) {
    let folder = out.join(manifest["folder"].as_str().unwrap());
    for file in manifest["files"].as_array().unwrap() {
        let bytes = fs::metadata(folder.join(file["path"].as_str().unwrap())).unwrap().len();
        assert_eq!(file["bytes"].as_u64(), Some(bytes));
    }
    assert!(files(&folder).len() + WITH_TIMES.len() == manifest["files"].as_array().unwrap().len());
}

/// One line of standard output.
fn estimate(sources: &[&Path], out: &Path) -> Value {
    let ended = end(&mut reconstruct(sources, out, &["--parts", "2", "--estimate"]));
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    serde_json::from_str(&ended.stdout).unwrap()
}

fn a_job_is_done_once_and_as_the_plain_command_does_it() {
    let folder = TempDir::new("store-once");
    let (store, plain) = (folder.join("store"), folder.join("plain"));
    let (bag, options) = (shipped("drawer"), ["--parts", "2"]);
    let before = estimate(&[&bag], &uri(&store));
    assert!(before["done"].is_null() && before["memory_bytes"].as_u64() > Some(50 << 20), "{before}");
    assert!(!store.exists());
    let ended = end(&mut reconstruct(&[&bag], &uri(&store), &options));
    assert!([0, 3].contains(&ended.code), "{}", ended.stderr);
    let made = manifest(&store);
    assert_eq!(made["key"], before["key"]);
    assert_eq!(made["exit_code"].as_i64(), Some(ended.code.into()));
    assert!(made["peak_memory_bytes"].as_u64() <= before["memory_bytes"].as_u64(), "{made} {before}");
    is_whole(&store, &made);
    let other = end(&mut reconstruct(&[&bag], &plain, &options));
    assert_eq!(other.code, ended.code);
    let result = store.join(made["folder"].as_str().unwrap());
    assert_eq!(files(&result), files(&plain.join("drawer")));
    // Nothing is left but the result and its manifest.
    assert_eq!(fs::read_dir(&store).unwrap().count(), 2);
    assert_eq!(fs::read_dir(store.join(made["key"].as_str().unwrap())).unwrap().count(), 1);

    let (begun, text) = (Instant::now(), fs::read(result.join("report.json")).unwrap());
    let again = end(&mut reconstruct(&[&uri(&bag)], &uri(&store), &["--parts", "2", "-v", "--json"]));
    assert!(begun.elapsed() < Duration::from_secs(2), "{:?}", begun.elapsed());
    assert_eq!(again.code, ended.code, "{}", again.stderr);
    let last: Value = serde_json::from_str(again.stdout.lines().last().unwrap()).unwrap();
    assert_eq!((&last["event"], &last["key"]), (&"job".into(), &made["key"]));
    assert_eq!(fs::read(result.join("report.json")).unwrap(), text);
    assert_eq!(estimate(&[&bag], &uri(&store))["done"], made["status"]);
}

fn a_job_with_another_setting_takes_the_stages_that_stand() {
    let folder = TempDir::new("store-stages");
    let (store, stages) = (folder.join("store"), folder.join("stages"));
    let bag = shipped("drawer");
    let setting = ["--parts", "2", "--set", "export.prefix=a_"];
    let run = |options: &[&str]| {
        let kept = ["--json", "--stages", stages.to_str().unwrap()];
        end(&mut reconstruct(&[&uri(&bag)], &uri(&store), &[options, &kept].concat()))
    };
    assert!([0, 3].contains(&run(&setting[..2]).code));
    let ended = run(&setting);
    assert!([0, 3].contains(&ended.code), "{}", ended.stderr);
    assert!(ended.stdout.contains("assemble was kept from"), "{}", ended.stdout);
    let made: Value = serde_json::from_str(ended.stdout.lines().last().unwrap()).unwrap();
    is_whole(&store, &made);
    let plain = folder.join("plain");
    assert_eq!(end(&mut reconstruct(&[&bag], &plain, &setting)).code, ended.code);
    assert_eq!(files(&store.join(made["folder"].as_str().unwrap())), files(&plain.join("drawer")));
}

fn a_refusal_is_kept_with_its_reason_and_not_met_again() {
    let folder = TempDir::new("store-refused");
    let (store, bag) = (folder.join("store"), folder.join("empty_room"));
    for state in 0..2 {
        let path = bag.join(format!("state{state}"));
        fs::create_dir_all(&path).unwrap();
        BagWriter::create(&path.join("a.mcap"), None, 1000).finish();
    }
    let run = || end(&mut reconstruct(&[&bag], &uri(&store), &[]));
    let first = run();
    assert_eq!(first.code, 1, "{}", first.stderr);
    let made = manifest(&store);
    assert_eq!((&made["status"], &made["exit_code"]), (&"refused".into(), &1.into()));
    assert!(made["folder"].is_null() && made["files"].as_array().unwrap().is_empty());
    let message = made["message"].as_str().unwrap();
    assert!(first.stderr.contains(message), "{} {message}", first.stderr);
    let second = run();
    assert_eq!(second.code, 1);
    assert!(second.stderr.contains(message) && second.stderr.contains("stands"), "{}", second.stderr);
    assert_eq!(fs::read_dir(&store).unwrap().count(), 1);
    // Settings that cannot be used are refused, too, under another key.
    let wrong = end(&mut reconstruct(&[&bag], &uri(&store), &["--set", "surface.node=9"]));
    assert_eq!(wrong.code, 2, "{}", wrong.stderr);
    assert_eq!(fs::read_dir(&store).unwrap().count(), 2);
}

#[cfg(unix)]
fn a_job_that_was_killed_is_done_by_the_next() {
    let folder = TempDir::new("store-killed");
    let store = folder.join("store");
    let command = || reconstruct(&[&shipped("drawer")], &uri(&store), &["--parts", "2", "--json"]);
    let mut first = command().stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let lines = BufReader::new(first.stdout.take().unwrap()).lines();
    // In the middle: the capture is kept, the rest is not.
    let stage =
        lines.map(Result::unwrap).find(|l| l.contains("stage_started") && l.contains("fusion/state0"));
    assert!(stage.is_some());
    // Another process with the same job does not wait.
    let busy = end(&mut command());
    assert_eq!(busy.code, 75, "{}", busy.stderr);
    first.kill().unwrap();
    first.wait().unwrap();
    assert!(fs::read_dir(&store).unwrap().all(|e| e.unwrap().path().extension().is_none_or(|e| e != "json")));
    let second = end(&mut command());
    assert!([0, 3].contains(&second.code), "{}", second.stderr);
    assert!(second.stdout.contains("stage_kept") || second.stdout.contains("capture"), "{}", second.stdout);
    is_whole(&store, &manifest(&store));
    assert_eq!(fs::read_dir(&store).unwrap().count(), 2);
}

#[cfg(unix)]
fn a_command_of_another_package_is_run_and_an_unknown_one_refused() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = TempDir::new("external");
    let path = folder.join("artitwin-hello");
    fs::write(&path, "#!/bin/sh\necho \"hello $1 from $ARTITWIN\"\nexit 7\n").unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    let run = |verb: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_artitwin"));
        let path = format!("{}:{}", folder.0.display(), std::env::var("PATH").unwrap());
        end(command.args([verb, "--you"]).env("PATH", path))
    };
    let hello = run("hello");
    assert_eq!((hello.code, hello.stdout.as_str().starts_with("hello --you from /")), (7, true));
    let unknown = run("recontruct");
    assert_eq!(unknown.code, 2);
    assert!(unknown.stderr.contains("reconstruct"), "{}", unknown.stderr);
}

/// A server that is stopped with the value.
struct Server {
    process: Child,
    python: PathBuf,
    port: u16,
}

impl Server {
    fn start() -> Result<Self, Missing> {
        if !cfg!(feature = "store") {
            return Err("the feature store is not built: give --features store".into());
        }
        let python = venv::python()?;
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/store_server.py");
        let mut process = Command::new(&python)
            .arg(script)
            .args(["0.05", "9"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(process.stdout.take().unwrap()).read_line(&mut line).unwrap();
        Ok(Self { process, python, port: line.trim().parse().unwrap() })
    }

    fn copy(&self, arguments: &[&str]) {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/store_client.py");
        let status =
            Command::new(&self.python).arg(script).arg(self.port.to_string()).args(arguments).status();
        assert!(status.unwrap().success());
    }

    fn counts(&self) -> Value {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.write_all(b"GET /counts HTTP/1.0\r\n\r\n").unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        serde_json::from_str(text.split_once("\r\n\r\n").unwrap().1).unwrap()
    }

    fn run(&self, command: &mut Command) -> Ended {
        end(command
            .env("AWS_ENDPOINT", format!("http://127.0.0.1:{}", self.port))
            .envs([("AWS_ALLOW_HTTP", "true"), ("AWS_REGION", "us-east-1")])
            .envs([("AWS_ACCESS_KEY_ID", "test"), ("AWS_SECRET_ACCESS_KEY", "test")]))
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.process.kill().ok();
        self.process.wait().ok();
    }
}

fn an_object_store_that_refuses_some_requests_gives_and_gets_the_same_bytes() -> Result<(), Missing> {
    let server = Server::start()?;
    let folder = TempDir::new("store-s3");
    let (plain, back, scratch) = (folder.join("plain"), folder.join("back"), folder.join("scratch"));
    server.copy(&["put", shipped("drawer").to_str().unwrap(), "day/drawer"]);
    let (bag, out) = (Path::new("s3://lab/day/drawer"), Path::new("s3://lab/out"));
    let options = ["--parts", "2", "--scratch", scratch.to_str().unwrap(), "--json"];
    let ended = server.run(&mut reconstruct(&[bag], out, &options));
    assert!([0, 3].contains(&ended.code), "{} {}", ended.stdout, ended.stderr);
    let made: Value = serde_json::from_str(ended.stdout.lines().last().unwrap()).unwrap();
    assert_eq!(made["event"], "job");
    let transfer = &made["transfer"];
    let of = |key: &str| transfer[key].as_u64().unwrap();
    let counts = server.counts();
    assert!(counts["refused"].as_u64() > Some(2) && counts["delayed"] == 1, "{counts}");
    assert!(of("retries") > 2 && of("retries") <= counts["refused"].as_u64().unwrap(), "{transfer} {counts}");
    assert!(of("requests") > 160 && of("bytes_written") > 1 << 20, "{transfer}");
    // The truth beside the states is not read.
    assert!(of("bytes_read") > 0 && of("bytes_read") <= of("bytes_stored") + (64 << 10), "{transfer}");
    assert_eq!(fs::read_dir(&scratch).unwrap().count(), 0);

    let other = end(&mut reconstruct(&[&shipped("drawer")], &plain, &["--parts", "2"]));
    assert_eq!(other.code, ended.code);
    server.copy(&["get", "out", back.to_str().unwrap()]);
    let result = back.join(made["folder"].as_str().unwrap());
    assert_eq!(files(&result), files(&plain.join("drawer")));
    let report = fs::read_to_string(result.join("report.json")).unwrap();
    assert!(report.contains("s3://lab/day/drawer") && !report.contains(scratch.to_str().unwrap()));

    let begun = Instant::now();
    let again = server.run(&mut reconstruct(&[bag], out, &options));
    assert!(again.code == ended.code && begun.elapsed() < Duration::from_secs(5), "{}", again.stderr);
    // What is not there is refused, and says so the next time, too.
    for _ in 0..2 {
        let missing = server.run(&mut reconstruct(&[Path::new("s3://lab/day/nope")], out, &options));
        assert_eq!(missing.code, 1, "{}", missing.stderr);
        assert!(missing.stderr.contains("s3://lab/day/nope` is not there"), "{}", missing.stderr);
    }
    // A store that cannot be reached says nothing of the recording.
    let mut nowhere = reconstruct(&[bag], Path::new("http://127.0.0.1:1/out"), &["--parts", "2"]);
    nowhere.env("ARTITWIN_STORE_PATIENCE_S", "1");
    assert_eq!(server.run(&mut nowhere).code, 75);
    Ok(())
}
