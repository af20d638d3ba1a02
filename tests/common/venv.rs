//! Pythons with the packages of `tests/python/requirements.txt` and, without their dependencies, of
//! `requirements.no-deps.txt` beside it; and of `tests/python/ros/requirements.txt`.

#![allow(dead_code, reason = "every test binary uses its own part of this")]

use std::{
    path::{Path, PathBuf},
    process::Command,
    sync::OnceLock,
};

use crate::harness::Missing;

/// What is missing, for Python and both environments.
const NO_PYTHON: &str = "python3 with venv is missing: apt-get install python3-venv";

/// The interpreter; what is missing, where there is none and none can be made.
///
/// `ARTITWIN_VENV` names a virtual environment to use, which then must hold every package of the files. Else
/// `.venv` in the repository is made once; that needs python3 with venv and pip, and a package index.
pub fn python() -> Result<PathBuf, Missing> {
    static FOUND: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    interpreter(&FOUND, "ARTITWIN_VENV", ".venv", "tests/python/requirements.txt")
}

/// The interpreter of the ROS 2 peers: `ARTITWIN_ROS_VENV`, else `.venv-ros`, under the same conditions.
pub fn ros_python() -> Result<PathBuf, Missing> {
    static FOUND: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    interpreter(&FOUND, "ARTITWIN_ROS_VENV", ".venv-ros", "tests/python/ros/requirements.txt")
}

/// Whether a program of the system runs: it is asked for its version or help by `argument`.
pub fn program(name: &str, argument: &str, package: &str) -> Result<(), Missing> {
    let runs = Command::new(name).arg(argument).output().is_ok();
    there(runs, name, package)
}

fn there(is_there: bool, name: &str, package: &str) -> Result<(), Missing> {
    if is_there { Ok(()) } else { Err(Missing(format!("{name} is missing: apt-get install {package}"))) }
}

/// Whether MuJoCo can draw by a shared library; `MUJOCO_GL` may name another way.
pub fn drawing(python: &Path, library: &str, package: &str) -> Result<(), Missing> {
    if std::env::var_os("MUJOCO_GL").is_some() {
        return Ok(());
    }
    let load = "import ctypes, sys\nctypes.CDLL(sys.argv[1])";
    let loads = succeed(Command::new(python).args(["-c", load, library])).is_ok();
    there(loads, library, package)
}

fn interpreter(
    found: &OnceLock<Result<PathBuf, String>>,
    variable: &str,
    folder: &str,
    requirements: &str,
) -> Result<PathBuf, Missing> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    if let Some(venv) = std::env::var_os(variable) {
        let named = || whole(Path::new(&venv).join("bin/python"), &root.join(requirements));
        let python = found.get_or_init(named).as_ref();
        return Ok(python.unwrap_or_else(|why| panic!("{variable}: {why}")).clone());
    }
    let made = found.get_or_init(|| lock().and_then(|_guard| find_or_make(folder, requirements)));
    made.clone().map_err(Missing)
}

/// The interpreter, if every package of the files is installed in the version that they name.
fn whole(python: PathBuf, requirements: &Path) -> Result<PathBuf, String> {
    let compare = "import sys\nfrom importlib.metadata import version\n\
                   for line in (l for path in sys.argv[1:] for l in open(path)):\n    name, _, wanted = \
                   line.split('#')[0].strip().partition('==')\n    name = name.partition('[')[0]\n    \
                   assert not name or version(name) == wanted, f'{name} is {version(name)}, not {wanted}'";
    let files = std::iter::once(requirements.to_owned()).chain(without_dependencies(requirements));
    succeed(Command::new(&python).args(["-c", compare]).args(files))?;
    Ok(python)
}

/// The file of packages that are installed without what they depend on, where there is one.
fn without_dependencies(requirements: &Path) -> Option<PathBuf> {
    Some(requirements.with_extension("no-deps.txt")).filter(|p| p.exists())
}

fn find_or_make(folder: &str, requirements: &str) -> Result<PathBuf, String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let requirements = root.join(requirements);
    let venv = root.join(folder);
    let (python, stamp) = (venv.join("bin/python"), venv.join("artitwin-requirements.txt"));
    let text = |path: &Path| std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()));
    let bare = without_dependencies(&requirements);
    let wanted = text(&requirements)? + &bare.as_deref().map(text).transpose()?.unwrap_or_default();
    if python.exists() && std::fs::read_to_string(&stamp).is_ok_and(|text| text == wanted) {
        return Ok(python);
    }
    // Debian's python3 has venv, but without python3-venv no ensurepip.
    if succeed(Command::new("python3").args(["-c", "import ensurepip, venv"])).is_err() {
        return Err(NO_PYTHON.to_owned());
    }
    succeed(Command::new("python3").args(["-m", "venv"]).arg(&venv))?;
    let install = |more: &[&str], file: &Path| {
        let quiet = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
        let run = succeed(Command::new(&python).args(quiet).args(more).arg("-r").arg(file));
        // One line of what pip says, which may be many.
        let last = |said: String| said.lines().last().unwrap_or_default().to_owned();
        run.map_err(|said| format!("pip cannot install {}: {}", file.display(), last(said)))
    };
    install(&[], &requirements)?;
    bare.as_deref().map_or(Ok(()), |file| install(&["--no-deps"], file))?;
    std::fs::write(&stamp, wanted).map_err(|e| format!("{}: {e}", stamp.display()))?;
    Ok(python)
}

/// Keeps two test programs from making the environment at the same time.
fn lock() -> Result<std::fs::File, String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("target");
    std::fs::create_dir_all(&path).map_err(|e| e.to_string())?;
    let file = std::fs::File::create(path.join("venv.lock")).map_err(|e| e.to_string())?;
    file.lock().map_err(|e| e.to_string())?;
    Ok(file)
}

fn succeed(command: &mut Command) -> Result<(), String> {
    let output = command.output().map_err(|e| format!("{command:?}: {e}"))?;
    if output.status.success() {
        Ok(())
    } else {
        Err(format!("{command:?}: {}", String::from_utf8_lossy(&output.stderr).trim()))
    }
}
