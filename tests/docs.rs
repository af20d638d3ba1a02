//! The commands of README, docs and eval run as printed, page by page, from top to bottom in one folder: a
//! fresh clone with the program installed.
//!
//! New commands are taken from the Markdown by themselves (`common/printed.rs`: how a block says that it is
//! not run, and why). A command has a shell of its own, the program, and a Python with
//! `tests/python/requirements.txt`.
//!
//! `ARTITWIN_ALL_COMMANDS=1` runs the slow ones, too. `ARTITWIN_PAGE=docs/recording.md` runs README and that
//! page alone, which shows that the page needs no other. The table of all commands, which `eval/commands.md`
//! keeps, is written to `commands.md` in the folder of the tests.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test may panic")]
#![allow(clippy::print_stderr, reason = "says what runs")]

#[path = "common/harness.rs"]
mod harness;
#[path = "common/printed.rs"]
mod printed;
#[path = "common/venv.rs"]
mod venv;

use std::{
    fmt::Write as _,
    fs,
    os::unix::fs::{PermissionsExt as _, symlink},
    path::{Path, PathBuf},
    process::{Command, ExitCode},
    time::Instant,
};

use harness::{Missing, tests};
use printed::{Mark, Printed, commands};

fn main() -> ExitCode {
    harness::main(tests![commands_run_as_printed])
}

/// What a clone holds, but for the source, which no command of a page reads.
const CLONE: [&str; 10] = [
    "ARCHITECTURE.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "README.md",
    "bags",
    "docs",
    "eval",
    "examples",
    "launch_configs",
    "tests",
];
/// As many commands run at least, so that none gets lost unseen.
const LEAST: usize = 60;

/// Runs its argument and adds a last line with its seconds of processor time.
const TIMED: &str = "TIMEFORMAT='%U %S'; time timeout --kill-after=5 600 bash -c \"$1\"";

/// `cargo` in a clone in which the program is built: `cargo run` has nothing to build and starts it.
const CARGO: &str = r#"#!/bin/sh
[ "$1 $2 $3 $4" = 'run --release --locked --' ] || exit 101
shift 4
exec artitwin "$@"
"#;

/// How a command ended.
struct Ran {
    seconds: f64,
    processor_seconds: f64,
    exit_code: i32,
    said: String,
}

fn commands_run_as_printed() -> Result<(), Missing> {
    let python = venv::python()?;
    // For the film of a page's demonstration.
    venv::drawing(&python, "libEGL.so.1", "libegl1")?;
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let only = std::env::var("ARTITWIN_PAGE").ok();
    let wanted = |page: &String| page == "README.md" || only.as_ref().is_none_or(|o| o == page);
    let folder = clone(root);
    let path = path(&folder, &python);
    let mut results = Vec::new();
    for page in pages(root).into_iter().filter(wanted) {
        for command in commands(&page, &fs::read_to_string(root.join(&page)).unwrap()) {
            let ran = is_run(&command).then(|| run(&command, &folder, &path));
            results.push((command, ran));
        }
    }
    let table = table(&results);
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("commands.md");
    fs::write(&file, &table).unwrap();
    eprintln!("{}: {}", file.display(), table.lines().next().unwrap_or_default());
    let failed: Vec<String> = results.iter().filter_map(failure).collect();
    assert!(failed.is_empty(), "in {}:\n{}", folder.display(), failed.join("\n"));
    let ran = results.iter().filter(|(_, ran)| ran.is_some()).count();
    assert!(only.is_some() || ran >= LEAST, "{ran} commands ran, {LEAST} at least");
    fs::remove_dir_all(&folder).unwrap();
    Ok(())
}

/// README, then the documents in the order of their list, then all other pages.
fn pages(root: &Path) -> Vec<String> {
    let mut pages = vec!["README.md".to_owned()];
    let list = fs::read_to_string(root.join("docs/README.md")).unwrap();
    let listed = list.split("](").skip(1).filter_map(|l| l.split(')').next());
    pages.extend(listed.filter(|l| l.ends_with(".md") && !l.contains('/')).map(|l| format!("docs/{l}")));
    let mut others = Vec::new();
    for folder in ["", "docs", "eval"] {
        markdown(root, Path::new(folder), &mut others);
    }
    others.sort();
    for page in others {
        if !pages.contains(&page) {
            pages.push(page);
        }
    }
    pages
}

/// Adds the Markdown files of a folder, and of those below it but at the root.
fn markdown(root: &Path, folder: &Path, pages: &mut Vec<String>) {
    for entry in fs::read_dir(root.join(folder)).unwrap() {
        let entry = entry.unwrap();
        let path = folder.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            if folder != Path::new("") {
                markdown(root, &path, pages);
            }
        } else if path.extension().is_some_and(|e| e == "md") {
            pages.push(path.to_str().unwrap().to_owned());
        }
    }
}

/// A folder that is as a fresh clone in which the program was built.
fn clone(root: &Path) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("printed/artitwin");
    fs::remove_dir_all(&folder).ok();
    fs::create_dir_all(folder.join("target/release")).unwrap();
    symlink(env!("CARGO_BIN_EXE_artitwin"), folder.join("target/release/artitwin")).unwrap();
    let cargo = folder.join("target/release/cargo");
    fs::write(&cargo, CARGO).unwrap();
    fs::set_permissions(&cargo, fs::Permissions::from_mode(0o755)).unwrap();
    let copy = Command::new("cp").arg("-r").args(CLONE.map(|c| root.join(c))).arg(&folder).status().unwrap();
    assert!(copy.success());
    folder
}

/// The program, the Python of the tests, and what else the system has.
fn path(folder: &Path, python: &Path) -> std::ffi::OsString {
    let system = std::env::var_os("PATH").unwrap();
    let own = [folder.join("target/release"), python.parent().unwrap().to_owned()];
    std::env::join_paths(own.into_iter().chain(std::env::split_paths(&system))).unwrap()
}

fn is_run(command: &Printed) -> bool {
    match command.mark {
        Mark::Runs => true,
        Mark::Slow(_) => std::env::var_os("ARTITWIN_ALL_COMMANDS").is_some_and(|all| all == "1"),
        Mark::NotRun(_) => false,
    }
}

fn run(command: &Printed, folder: &Path, path: &std::ffi::OsStr) -> Ran {
    let text = &command.text;
    let moves = ["cd ", "export ", "source ", ". "].iter().any(|m| text.starts_with(m));
    assert!(!moves, "{}:{}: {text}: every command has a shell of its own", command.page, command.line);
    eprintln!("{}:{}: {text}", command.page, command.line);
    let mut shell = Command::new("bash");
    shell.args(["-c", TIMED, "bash", text]).current_dir(folder).env("PATH", path);
    let start = Instant::now();
    let output = shell.stdin(std::process::Stdio::null()).output().unwrap();
    let seconds = start.elapsed().as_secs_f64();
    let said = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).trim_end().to_owned();
    let (said, times) = said.rsplit_once('\n').unwrap_or(("", &said));
    let processor_seconds = times.split(' ').map(|t| t.parse::<f64>().unwrap()).sum();
    let exit_code = output.status.code().unwrap_or(-1);
    Ran { seconds, processor_seconds, exit_code, said: said.to_owned() }
}

/// What is wrong with how a command ended.
fn failure((command, ran): &(Printed, Option<Ran>)) -> Option<String> {
    let Printed { page, line, text, exit_code, .. } = command;
    let ran = ran.as_ref().filter(|r| r.exit_code != *exit_code)?;
    let tail: Vec<&str> = ran.said.lines().rev().take(12).collect();
    let tail: String = tail.iter().rev().fold(String::new(), |all, l| all + "    " + l + "\n");
    Some(format!("{page}:{line}: {text}\n  exit code {}, not {exit_code}:\n{tail}", ran.exit_code))
}

/// All commands, those that ran with their seconds and exit codes, the others with the reason.
fn table(results: &[(Printed, Option<Ran>)]) -> String {
    let cell = |text: &str| text.replace('|', "\\|").replace(" \\\n", " ").replace('\n', "; ");
    let (mut ran, mut left) = (String::new(), String::new());
    let (mut count, mut failed, mut wall, mut processor) = (0, 0, 0.0, 0.0);
    for (command, result) in results {
        let start = format!("| {} | `{}` |", command.page, cell(&command.text));
        let why = match (result, &command.mark) {
            (Some(r), _) => {
                let verdict = if r.exit_code == command.exit_code { "" } else { ", NOT as printed" };
                let (seconds, of_cpu, code) = (r.seconds, r.processor_seconds, r.exit_code);
                writeln!(ran, "{start} {seconds:.1} | {of_cpu:.1} | {code}{verdict} |").unwrap();
                (count, failed) = (count + 1, failed + usize::from(!verdict.is_empty()));
                (wall, processor) = (wall + seconds, processor + of_cpu);
                continue;
            }
            (None, Mark::NotRun(why)) => why.clone(),
            (None, Mark::Slow(time)) => format!("slow: {time}"),
            (None, Mark::Runs) => unreachable!("{command:?}"),
        };
        writeln!(left, "{start} {why} |").unwrap();
    }
    let (all, good) = (results.len(), count - failed);
    format!(
        "{count} of {all} commands ran, {good} as printed, in {wall:.0} s ({processor:.0} s of processor \
         time).\n\n\
         | page | command | seconds | processor | exit code |\n|---|---|---|---|---|\n{ran}\n\
         | page | command | not run |\n|---|---|---|\n{left}"
    )
}
