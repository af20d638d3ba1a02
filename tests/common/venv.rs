//! A Python with the packages of `tests/python/requirements.txt`.

use std::{
    path::{Path, PathBuf},
    process::Command,
    sync::OnceLock,
};

/// The interpreter; `None`, with a line that says why, where there is none and none can be made.
///
/// `ARTITWIN_VENV` names a virtual environment to use, which then must be there. Else `.venv` in the repository is made
/// once; that needs python3 with venv and pip, and a package index.
pub fn python() -> Option<PathBuf> {
    static FOUND: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    if let Some(venv) = std::env::var_os("ARTITWIN_VENV") {
        let python = Path::new(&venv).join("bin/python");
        assert!(python.exists(), "{} does not exist (ARTITWIN_VENV)", python.display());
        return Some(python);
    }
    match FOUND.get_or_init(|| lock().and_then(|_guard| find_or_make())) {
        Ok(path) => Some(path.clone()),
        Err(why) => {
            eprintln!("skipped: {why}");
            None
        }
    }
}

fn find_or_make() -> Result<PathBuf, String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let requirements = root.join("tests/python/requirements.txt");
    let venv = root.join(".venv");
    let (python, stamp) = (venv.join("bin/python"), venv.join("artitwin-requirements.txt"));
    let wanted = std::fs::read_to_string(&requirements).map_err(|e| format!("{}: {e}", requirements.display()))?;
    if python.exists() && std::fs::read_to_string(&stamp).is_ok_and(|text| text == wanted) {
        return Ok(python);
    }
    succeed(Command::new("python3").args(["-m", "venv"]).arg(&venv))?;
    succeed(Command::new(&python).args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-r"]).arg(&requirements))?;
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
    if output.status.success() { Ok(()) } else { Err(format!("{command:?}: {}", String::from_utf8_lossy(&output.stderr).trim())) }
}
