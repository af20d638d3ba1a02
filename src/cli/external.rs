//! Commands of other packages: `artitwin NAME` runs `artitwin-NAME`.

use std::{
    env,
    ffi::OsString,
    path::{Path, PathBuf},
    process::Command,
};

use super::exit::{CliError, Exit};

/// Longest name of a command.
const MAX_NAME: usize = 64;

/// The program for the first of the arguments, and the other arguments; `None` without such a program. It is
/// looked for beside this program, then in the folders of `PATH`.
pub(super) fn find_program(arguments: &[OsString]) -> Option<(PathBuf, &[OsString])> {
    let (name, rest) = arguments.get(1..)?.split_first()?;
    let name = name.to_str().filter(|n| is_name(n))?;
    let file = format!("artitwin-{name}{}", env::consts::EXE_SUFFIX);
    let own = env::current_exe().ok().and_then(|p| p.parent().map(Path::to_owned));
    let path = env::var_os("PATH").unwrap_or_default();
    // An empty entry of PATH is the current folder: nothing is run from there unasked.
    let folders = own.into_iter().chain(env::split_paths(&path).filter(|p| p.is_absolute()));
    folders.map(|folder| folder.join(&file)).find(|p| is_program(p)).map(|program| (program, rest))
}

fn is_name(name: &str) -> bool {
    name.len() <= MAX_NAME
        && name.starts_with(|c: char| c.is_ascii_lowercase())
        && name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-')
}

#[cfg(unix)]
fn is_program(path: &Path) -> bool {
    use std::os::unix::fs::PermissionsExt as _;
    path.metadata().is_ok_and(|m| m.is_file() && m.permissions().mode() & 0o111 != 0)
}

#[cfg(not(unix))]
fn is_program(path: &Path) -> bool {
    path.is_file()
}

/// Becomes the program. It finds this one by `ARTITWIN`.
///
/// # Errors
/// If it cannot be started.
pub(super) fn run_program(program: &Path, arguments: &[OsString]) -> Result<Exit, CliError> {
    let mut command = Command::new(program);
    command.args(arguments);
    if let Ok(own) = env::current_exe() {
        command.env("ARTITWIN", own);
    }
    let failed = |source| CliError::External { path: program.to_owned(), source };
    #[cfg(unix)]
    {
        use std::os::unix::process::CommandExt as _;
        Err(failed(command.exec()))
    }
    #[cfg(not(unix))]
    {
        let status = command.status().map_err(failed)?;
        Ok(if status.success() { Exit::Done } else { Exit::Failed })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_commands_are_plain() {
        for name in ["fleet", "my-tool2"] {
            assert!(is_name(name));
        }
        for name in ["", "-h", "--help", "Fleet", "../x", "a/b", "a b"] {
            assert!(!is_name(name), "{name}");
        }
        let arguments = ["artitwin", "no-such-command-is-here"].map(OsString::from);
        assert!(find_program(&arguments).is_none());
    }
}
