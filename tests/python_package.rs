//! The Python package: its wheel in an environment of its own, its functions, its types, and the notebook of
//! `examples/`.
//!
//! Needs Python (see `common/venv.rs`).

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stderr, reason = "a test may panic")]

#[path = "common/harness.rs"]
mod harness;
#[path = "common/venv.rs"]
mod venv;

use std::{
    path::{Path, PathBuf},
    process::{Command, ExitCode},
    sync::OnceLock,
};

use harness::{Missing, tests};

fn main() -> ExitCode {
    harness::main(tests![
        functions_do_what_the_commands_do,
        the_fleet_is_a_script_and_ray_is_left_out_elsewhere,
        types_are_whole,
        the_notebook_names_the_effect_that_it_put_in,
    ])
}

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// A file of these tests.
fn own(name: &str) -> PathBuf {
    Path::new(ROOT).join("tests/python/package").join(name)
}

/// An empty folder of these tests.
fn folder(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("python_package").join(name);
    std::fs::remove_dir_all(&path).ok();
    std::fs::create_dir_all(&path).unwrap();
    path
}

/// What a command that must succeed prints.
fn output(command: &mut Command) -> String {
    let output = command.output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(output.status.success(), "{command:?}: {}{}", text(&output.stdout), text(&output.stderr));
    text(&output.stdout)
}

/// The wheel, around the program that these tests were built with.
fn wheel(python: &Path) -> PathBuf {
    let (out, source) = (folder("wheel"), Path::new(ROOT).join("src/main.rs"));
    let id = output(Command::new(env!("CARGO")).current_dir(ROOT).args(["pkgid", "--locked"]));
    let built = serde_json::json!({
        "reason": "compiler-artifact",
        "package_id": id.trim(),
        "manifest_path": Path::new(ROOT).join("Cargo.toml"),
        "target": {
            "kind": ["bin"], "crate_types": ["bin"], "name": "artitwin", "src_path": source,
            "edition": "2024", "doc": true, "doctest": false, "test": true,
        },
        "profile": {
            "opt_level": "3", "debuginfo": 0, "debug_assertions": false, "overflow_checks": false,
            "test": false,
        },
        "features": [],
        "filenames": [env!("CARGO_BIN_EXE_artitwin")],
        "executable": env!("CARGO_BIN_EXE_artitwin"),
        "fresh": true,
    });
    let mut maturin = Command::new(python.with_file_name("maturin"));
    maturin.env("CARGO", own("cargo")).env("REAL_CARGO", env!("CARGO")).env("BUILT", built.to_string());
    output(maturin.current_dir(ROOT).args(["build", "--release", "--locked", "--quiet", "--out"]).arg(&out));
    let found: Vec<_> = std::fs::read_dir(&out).unwrap().map(|e| e.unwrap().path()).collect();
    let [wheel] = found.as_slice() else { panic!("one wheel is expected, not {found:?}") };
    wheel.clone()
}

/// The interpreter of a new environment with the wheel, which finds all other packages where the tests have
/// them.
fn installed() -> Result<PathBuf, Missing> {
    static FOUND: OnceLock<Result<PathBuf, Missing>> = OnceLock::new();
    let make = || {
        let python = venv::python()?;
        let wheel = wheel(&python);
        let name = wheel.file_name().unwrap().to_str().unwrap();
        // One wheel for all versions of Python.
        assert!(name.starts_with(concat!("artitwin-", env!("CARGO_PKG_VERSION"), "-py3-none-")), "{name}");
        let environment = folder("venv");
        output(Command::new(&python).args(["-m", "venv", "--without-pip"]).arg(&environment));
        let own_python = environment.join("bin/python");
        let packages = |python: &Path| {
            let ask = "import sysconfig\nprint(sysconfig.get_path('purelib'))";
            output(Command::new(python).args(["-c", ask])).trim().to_owned()
        };
        let more = Path::new(&packages(&own_python)).join("packages_of_tests.pth");
        std::fs::write(more, packages(&python)).unwrap();
        let mut pip = Command::new(&python);
        // Without an index: what the wheel needs must be there.
        pip.args(["-m", "pip", "--disable-pip-version-check", "--python"]).arg(&own_python);
        output(pip.args(["install", "--quiet", "--no-index"]).arg(&wheel));
        Ok(own_python)
    };
    FOUND.get_or_init(make).clone()
}

fn functions_do_what_the_commands_do() -> Result<(), Missing> {
    let python = installed()?;
    let mut command = Command::new(&python);
    command.arg(own("functions.py")).arg(Path::new(ROOT).join("bags/drawer")).arg(folder("functions"));
    output(command.env_remove("ARTITWIN_PROGRAM"));
    let version = output(Command::new(&python).args(["-m", "artitwin", "--version"]));
    assert_eq!(version, concat!("artitwin ", env!("CARGO_PKG_VERSION"), "\n"));
    Ok(())
}

fn the_fleet_is_a_script_and_ray_is_left_out_elsewhere() -> Result<(), Missing> {
    let python = installed()?;
    let text = output(Command::new(python.with_file_name("artitwin-fleet")).arg("--help"));
    assert!(text.contains("--objects TABLE|GLOB"), "{text}");
    let ask = "import sys, artitwin\nprint(any(name in sys.modules for name in ('ray', 'pyarrow')))";
    assert_eq!(output(Command::new(&python).args(["-c", ask])), "False\n");
    Ok(())
}

fn types_are_whole() -> Result<(), Missing> {
    let python = installed()?;
    let mut mypy = Command::new(&python);
    mypy.args(["-m", "mypy", "--strict", "--python-version", "3.10", "--cache-dir"]).arg(folder("mypy"));
    // Installed, as a user has it.
    output(mypy.current_dir(ROOT).args(["-p", "artitwin"]).arg("--config-file="));
    let mut mypy = Command::new(&python);
    mypy.args(["-m", "mypy", "--strict", "--cache-dir"]).arg(folder("mypy")).arg(own("example.py"));
    output(mypy.arg("--config-file="));
    Ok(())
}

fn the_notebook_names_the_effect_that_it_put_in() -> Result<(), Missing> {
    let python = installed()?;
    let mut command = Command::new(&python);
    command.arg(own("notebook.py")).arg(Path::new(ROOT).join("examples/notebook.ipynb"));
    let text = output(command.env_remove("ARTITWIN_PROGRAM").env("TMPDIR", folder("notebook")));
    let said: serde_json::Value = serde_json::from_str(text.trim()).unwrap();
    let (report, number) = (&said["report"], |value: &serde_json::Value| value.as_f64().unwrap());
    let hidden = said["hidden"].as_object().unwrap();
    let found = said["found"].as_object().unwrap();
    assert_eq!(report["verdict"], "named", "{said}");
    assert!(hidden.keys().eq(found.keys()) && hidden.len() == 1, "{said}");
    for ((effect, value), interval) in hidden.iter().zip(said["intervals"].as_array().unwrap()) {
        let (found, value) = (number(&found[effect][0]), number(value));
        assert!((found - value).abs() < 0.05 * value, "{effect}: {found} for {value}");
        assert!(number(&interval[0]) < value && value < number(&interval[1]), "{said}");
    }
    // What the functions give are the numbers of the file.
    assert_eq!(found["coulomb_friction"][0], report["findings"][0]["parameters"][0]["value"]);
    for (given, key) in said["gap"].as_array().unwrap().iter().zip(["before", "after", "noise_floor"]) {
        assert_eq!(given, &report["gap"][key], "{key}");
    }
    assert!(said["files"].as_array().unwrap().iter().all(|there| there == true), "{said}");
    Ok(())
}
