//! Folders beside a result, under free names.

use std::{
    ffi::{OsStr, OsString},
    fs, io,
    path::{Path, PathBuf},
};

use super::RunDirError;

/// Largest number of names tried for a folder beside the result.
const MAX_TRIES: usize = 1000;

/// Makes a new hidden folder `.<name>.<suffix>-<process>-<k>`.
pub(super) fn free_sibling(out: &Path, name: &OsStr, suffix: &str) -> Result<PathBuf, RunDirError> {
    first_free(|k| out.join(hidden_name(name, suffix, k)), |path| fs::create_dir(path))
}

fn hidden_name(name: &OsStr, suffix: &str, k: usize) -> OsString {
    let mut hidden = OsString::from(".");
    hidden.push(name);
    hidden.push(format!(".{suffix}-{}-{k}", std::process::id()));
    hidden
}

/// The first path for which `make` succeeds; existing ones are skipped.
pub(super) fn first_free(
    path: impl Fn(usize) -> PathBuf,
    make: impl Fn(&Path) -> io::Result<()>,
) -> Result<PathBuf, RunDirError> {
    let mut k = 0;
    loop {
        let path = path(k);
        // Created at once: between a check and the creation, another process could take the name.
        match make(&path) {
            Ok(()) => return Ok(path),
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists && k < MAX_TRIES => k += 1,
            Err(source) => return Err(RunDirError::Disk { what: "make", path, source }),
        }
    }
}
