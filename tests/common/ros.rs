//! The node as a process, and what its neighbors do.

#![allow(dead_code, reason = "every test binary uses its own part of this")]

use std::{
    io::Read as _,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::{Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

use crate::{harness::Missing, venv};

/// A machine is a network namespace, and a cable between two is a pair of interfaces.
const NO_NAMESPACES: &str =
    "network namespaces are missing: apt-get install iproute2, and run the tests as root";

/// One test of the network at a time: they need a core each.
pub fn serial() -> MutexGuard<'static, ()> {
    static SERIAL: Mutex<()> = Mutex::new(());
    SERIAL.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What a test says that needs more of its neighbors than Fast DDS gives.
pub const ONLY_CYCLONE: &str = "Cyclone DDS is missing: run the test without DDS_PEER=fastdds";

/// Whether the neighbors are made of Fast DDS (`tests/fastdds/run.sh`), not of Cyclone DDS.
pub fn with_fastdds() -> bool {
    std::env::var_os("DDS_PEER").is_some_and(|peer| peer == "fastdds")
}

/// The Python of the node's neighbors on Linux, where a process' sockets and memory are read from /proc.
pub fn linux_python() -> Result<PathBuf, Missing> {
    if cfg!(target_os = "linux") { venv::ros_python() } else { Err("Linux is missing".into()) }
}

/// Runs a script of `tests/python/ros` in a network namespace of its own, with the program, a folder and
/// these arguments; what it prints.
pub fn printed_in_namespace(script: &str, arguments: &[&str]) -> Result<serde_json::Value, Missing> {
    let python = linux_python()?;
    if !Command::new("unshare").args(["--net", "true"]).status().is_ok_and(|s| s.success()) {
        return Err(NO_NAMESPACES.into());
    }
    let _serial = serial();
    let folder = tempfile::tempdir().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/ros").join(script);
    let mut command = Command::new("unshare");
    command.arg("--net").arg(python).arg(script).arg(env!("CARGO_BIN_EXE_artitwin")).arg(folder.path());
    let output = command.args(arguments).env_remove("CYCLONEDDS_URI").output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    if output.status.code() == Some(3) {
        eprintln!("{error}");
        return Err(NO_NAMESPACES.into());
    }
    assert!(output.status.success(), "{error}");
    Ok(serde_json::from_slice(&output.stdout).unwrap())
}

/// A running node; ended with it.
pub struct Node {
    child: Option<Child>,
}

impl Node {
    /// Starts a node in a domain with these parameters.
    pub fn start(domain: u16, parameters: &[String]) -> Self {
        Self::start_with(domain, parameters, &[])
    }

    /// Starts a node with further arguments of ROS 2.
    pub fn start_with(domain: u16, parameters: &[String], arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_artitwin"));
        command.args(["node", "--ros-args"]).args(arguments);
        for parameter in parameters {
            command.args(["-p", parameter]);
        }
        command.env("ROS_DOMAIN_ID", domain.to_string()).env_remove("RMW_IMPLEMENTATION");
        for variable in ["ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_SECURITY_ENABLE"] {
            command.env_remove(variable);
        }
        // These neighbors stand on the loopback interface; tests/node_citizen.rs has those of ROS 2.
        command.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
        Self { child: Some(command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()) }
    }

    /// Process id.
    pub fn id(&self) -> u32 {
        self.child.as_ref().unwrap().id()
    }

    /// Whether it still runs.
    pub fn lives(&self) -> bool {
        Path::new(&format!("/proc/{}/stat", self.id())).exists()
    }

    /// Ends it as a crash would.
    pub fn kill(mut self) {
        let mut child = self.child.take().unwrap();
        child.kill().unwrap();
        child.wait().unwrap();
    }

    /// Asks it to end and gives what it said. Panics if it does not end well.
    pub fn end(mut self) -> String {
        let mut child = self.child.take().unwrap();
        Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap();
        let mut text = String::new();
        child.stderr.take().unwrap().read_to_string(&mut text).unwrap();
        let status = child.wait().unwrap();
        assert!(status.success(), "the node ended with {status}: {text}");
        text
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            child.kill().ok();
            let mut text = String::new();
            if let Some(mut stderr) = child.stderr.take() {
                stderr.read_to_string(&mut text).ok();
            }
            child.wait().ok();
            eprintln!("the node said:\n{text}");
        }
    }
}

/// Waits until a file is there.
pub fn wait_for(path: &Path) {
    let start = Instant::now();
    while !path.exists() {
        assert!(start.elapsed() < Duration::from_secs(20), "{} does not appear", path.display());
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Runs a scenario of `tests/python/ros/scenario.py` in a domain; what it prints.
pub fn scenario(python: &Path, domain: u16, arguments: &[&str]) -> serde_json::Value {
    lossy_scenario(python, domain, 0, arguments)
}

/// The same, where so many of a thousand packets are dropped on sending.
pub fn lossy_scenario(
    python: &Path,
    domain: u16,
    loss_per_mille: u32,
    arguments: &[&str],
) -> serde_json::Value {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/ros/scenario.py");
    let start = Instant::now();
    let mut command = Command::new(python);
    command.arg(script).args(arguments).env("ROS_DOMAIN_ID", domain.to_string());
    let output = command.env("XMIT_LOSS_PER_MILLE", loss_per_mille.to_string()).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(output.status.success(), "{arguments:?} after {:?}: {}", start.elapsed(), text(&output.stderr));
    assert!(start.elapsed() < Duration::from_secs(900), "{arguments:?} took {:?}", start.elapsed());
    serde_json::from_str(text(&output.stdout).trim().lines().last().unwrap()).unwrap()
}
