//! A robot opens and closes a finished twin in MuJoCo, by contact alone. A Python program that is embedded in
//! this one does it.

use std::{
    io::{BufRead as _, BufReader, Write as _},
    path::{Path, PathBuf},
    process::{Child, ChildStderr, Command, Stdio},
    sync::{
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, RecvTimeoutError, channel},
    },
    time::Duration,
};

use serde::Deserialize;

use super::{Cancelled, least_bytes::DEMONSTRATION};
use common::files;
use common::limits;
use common::note::Note;
use io::{Place, ResultKind, RunDir, RunDirError};

/// The modules of the Python program, one per line.
const MODULES: [(&str, &str); 8] = [
    ("ball", include_str!("demonstrate/ball.py")),
    ("demo", include_str!("demonstrate/demo.py")),
    ("gripper", include_str!("demonstrate/gripper.py")),
    ("hold", include_str!("demonstrate/hold.py")),
    ("panda", include_str!("demonstrate/panda.py")),
    ("picture", include_str!("demonstrate/picture.py")),
    ("stage", include_str!("demonstrate/stage.py")),
    ("twin", include_str!("demonstrate/twin.py")),
];
/// The loader of the modules.
const BOOTSTRAP: &str = include_str!("demonstrate/bootstrap.py");
/// Interval between checks for a stop request.
const LOOK: Duration = Duration::from_millis(100);
/// Largest reported line of the Python process, bytes.
const LONGEST_LINE: usize = 2000;

/// Request for a demonstration.
#[derive(Clone, Debug)]
pub struct DemonstrateRequest {
    /// Folder of a finished twin, with its MJCF.
    pub twin: PathBuf,
    /// Where the result goes.
    pub place: Place,
    /// The Python interpreter, with mujoco, numpy and pillow.
    pub python: PathBuf,
    /// `gripper` or `panda`.
    pub robot: String,
    /// Whether a film is made.
    pub film: bool,
}

/// A finished demonstration.
#[derive(Clone, Debug)]
pub struct Demonstration {
    /// The result's folder.
    pub folder: PathBuf,
    /// The table of joints.
    pub table: String,
    /// Whether every joint was opened and closed, and every ball stayed.
    pub whole: bool,
    /// Note on where an earlier result was moved.
    pub note: Option<Note>,
}

/// Why there is no demonstration.
#[derive(Debug, thiserror::Error)]
pub enum DemonstrateError {
    /// The result cannot be written.
    #[error(transparent)]
    Output(#[from] RunDirError),
    /// The folder is not that of a twin.
    #[error("cannot read the twin in {}; give the folder of a finished run", path.display())]
    Twin {
        /// Its path.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The interpreter does not start.
    #[error("cannot run the Python `{}`; name one with mujoco, numpy and pillow by --python", path.display())]
    Python {
        /// The interpreter.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The interpreter ended without a result; this is its last line.
    #[error("no demonstration: {0}")]
    Refused(String),
    /// A file of the result cannot be read back.
    #[error("cannot read the demonstration's {name}")]
    Result {
        /// The file.
        name: &'static str,
        /// The error.
        source: std::io::Error,
    },
    /// Stopped on request.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Opens and closes every joint of a twin by contact alone, in MuJoCo, and films it. `say` is called with a
/// line per step. The folder contains `demo.json`, `demo.txt` and the film; it appears when it is complete.
///
/// # Errors
/// If the place is taken, the folder has no twin, Python lacks packages, or a stop is requested.
pub fn demonstrate(
    request: &DemonstrateRequest,
    stop: &AtomicBool,
    mut say: impl FnMut(&str),
) -> Result<Demonstration, DemonstrateError> {
    let twin = request.twin.canonicalize().and_then(|p| p.read_dir().map(|_| p));
    let twin = twin.map_err(|source| DemonstrateError::Twin { path: request.twin.clone(), source })?;
    request.place.check(ResultKind::Demo, DEMONSTRATION)?;
    let dir = RunDir::open(&request.place, ResultKind::Demo)?;
    let mut child = started(request, &twin, &dir)?;
    let last = follow(&mut child, stop, &mut say)?;
    let ended = child.wait();
    if stop.load(Ordering::Relaxed) {
        return Err(Cancelled::default().into());
    }
    if !ended.is_ok_and(|status| status.success()) {
        return Err(DemonstrateError::Refused(last));
    }
    let table = result_text(&dir, "demo.txt")?;
    let json = result_text(&dir, "demo.json")?;
    let report: Report = serde_json::from_str(&json)
        .map_err(|e| DemonstrateError::Result { name: "demo.json", source: e.into() })?;
    let committed = dir.commit()?;
    Ok(Demonstration {
        whole: report.joints.iter().all(|j| j.success),
        table,
        note: committed.note(),
        folder: committed.folder,
    })
}

/// The text of a file of the result.
fn result_text(dir: &RunDir, name: &'static str) -> Result<String, DemonstrateError> {
    files::read_text(&dir.working().join(name), limits::REPORT)
        .map_err(|source| DemonstrateError::Result { name, source })
}

/// The fields of `demo.json` that are read.
#[derive(Deserialize)]
struct Report {
    joints: Vec<JointReport>,
}

#[derive(Deserialize)]
struct JointReport {
    success: bool,
}

/// Starts the interpreter and gives it all modules.
fn started(request: &DemonstrateRequest, twin: &Path, dir: &RunDir) -> Result<Child, DemonstrateError> {
    let mut command = Command::new(&request.python);
    command.args(["-c", BOOTSTRAP]).arg(twin).arg(dir.working());
    command.args(["--robot", &request.robot]);
    if !request.film {
        command.arg("--no-film");
    }
    command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
    let mut child = command
        .spawn()
        .map_err(|source| DemonstrateError::Python { path: request.python.clone(), source })?;
    let modules: std::collections::BTreeMap<_, _> = MODULES.into_iter().collect();
    let text = serde_json::to_string(&modules).unwrap_or_default();
    if let Some(mut input) = child.stdin.take() {
        // In a thread, as an interpreter that hangs does not read; one that ended prints its reason.
        std::thread::spawn(move || input.write_all(text.as_bytes()));
    }
    Ok(child)
}

/// Forwards the Python process' lines until it ends, or ends it on request. Returns its last line.
fn follow(
    child: &mut Child,
    stop: &AtomicBool,
    say: &mut impl FnMut(&str),
) -> Result<String, DemonstrateError> {
    let Some(output) = child.stderr.take() else { return Ok(String::new()) };
    let lines = lines(output);
    let mut last = "Python ended without a word".to_owned();
    loop {
        match lines.recv_timeout(LOOK) {
            Ok(line) => {
                say(&line);
                last = line;
            }
            Err(RecvTimeoutError::Disconnected) => return Ok(last),
            Err(RecvTimeoutError::Timeout) if stop.load(Ordering::Relaxed) => {
                child.kill().unwrap_or_default();
                child.wait().map(drop).unwrap_or_default();
                return Err(Cancelled::default().into());
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
    }
}

/// The lines of a pipe, read by a separate thread.
fn lines(output: ChildStderr) -> Receiver<String> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        let mut reader = BufReader::new(output);
        let mut bytes = Vec::new();
        while reader.read_until(b'\n', &mut bytes).is_ok_and(|n| n > 0) {
            bytes.truncate(LONGEST_LINE);
            let line = String::from_utf8_lossy(&bytes).trim_end().to_owned();
            if !line.is_empty() && sender.send(line).is_err() {
                return;
            }
            bytes.clear();
        }
    });
    receiver
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(folder: &tempfile::TempDir, python: &str) -> DemonstrateRequest {
        DemonstrateRequest {
            twin: folder.path().join("twin"),
            place: Place::at(folder.path().join("demo")),
            python: python.into(),
            robot: "gripper".to_owned(),
            film: false,
        }
    }

    /// A script in place of Python.
    #[cfg(unix)]
    fn peer(folder: &tempfile::TempDir, script: &str) -> String {
        use std::os::unix::fs::PermissionsExt as _;
        let path = folder.path().join("peer");
        std::fs::write(&path, format!("#!/bin/sh\ncat > /dev/null\n{script}\n")).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
        path.to_string_lossy().into_owned()
    }

    #[test]
    fn what_cannot_be_demonstrated_is_said_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let ended = |python: &str| {
            let error = demonstrate(&request(&folder, python), &AtomicBool::new(false), |_| {}).unwrap_err();
            error.to_string()
        };
        assert!(ended("python3").contains("folder of a finished run"));
        std::fs::create_dir(folder.path().join("twin")).unwrap();
        assert!(ended("no-such-python").contains("--python"));
        assert!(!folder.path().join("demo").exists());
    }

    #[test]
    #[cfg(unix)]
    fn a_peer_that_fails_is_quoted_and_one_that_hangs_can_be_stopped() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("twin")).unwrap();
        let python = peer(&folder, "echo step >&2; echo 'pip install mujoco' >&2; exit 1");
        let mut said = Vec::new();
        let error = demonstrate(&request(&folder, &python), &AtomicBool::new(false), |l| {
            said.push(l.to_owned());
        });
        assert_eq!(error.unwrap_err().to_string(), "no demonstration: pip install mujoco");
        assert_eq!(said, ["step", "pip install mujoco"]);
        let python = peer(&folder, "exec sleep 60");
        let stopped = demonstrate(&request(&folder, &python), &AtomicBool::new(true), |_| {});
        assert!(matches!(stopped, Err(DemonstrateError::Cancelled(_))));
        // Success without a result is none.
        let python = peer(&folder, "exit 0");
        let nothing = demonstrate(&request(&folder, &python), &AtomicBool::new(false), |_| {});
        assert!(matches!(nothing, Err(DemonstrateError::Result { .. })));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "a peer and a twin");
    }
}
