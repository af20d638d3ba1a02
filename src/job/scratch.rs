//! A folder for what a job fetches and makes on its way, the same for the same job.

use std::{
    fs,
    path::{Path, PathBuf},
};

use super::{JobError, hold::Hold};

/// The folder of one job, held by one process at a time. What a process that was killed left in it is used by
/// the next.
#[derive(Debug)]
pub struct Scratch {
    folder: PathBuf,
    is_kept: bool,
    _hold: Hold,
}

impl Scratch {
    /// Opens the folder of a job below `base`, or below the system's folder for temporary files.
    ///
    /// # Errors
    /// [`JobError::Busy`] where another process works on the job; a disk that refuses; a folder of that name
    /// that somebody else made.
    pub fn open(base: Option<&Path>, key: &str) -> Result<Self, JobError> {
        let base = base.map_or_else(std::env::temp_dir, Path::to_owned);
        let folder = base.join(format!("artitwin-{key}"));
        let fails = |source| JobError::Disk { path: folder.clone(), source };
        let hold = Hold::take(base.join(format!("artitwin-{key}.lock")))?;
        match make(&folder) {
            Ok(()) => {}
            // Its name can be foreseen, and folders for temporary files are shared.
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {
                if !is_ours(&folder) {
                    return Err(fails(error));
                }
            }
            Err(source) => return Err(fails(source)),
        }
        Ok(Self { folder, is_kept: false, _hold: hold })
    }

    /// Where inputs are fetched to.
    #[must_use]
    pub fn inputs(&self) -> PathBuf {
        self.folder.join("in")
    }

    /// Where a result is made that goes to a store.
    #[must_use]
    pub fn results(&self) -> PathBuf {
        self.folder.join("out")
    }

    /// Leaves the folder for the next process that works on the job.
    pub fn keep(&mut self) {
        self.is_kept = true;
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        if !self.is_kept {
            fs::remove_dir_all(&self.folder).ok();
        }
    }
}

#[cfg(unix)]
fn make(folder: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::DirBuilderExt as _;
    // Recordings may be secret where the disk is shared.
    fs::DirBuilder::new().mode(0o700).create(folder)
}

#[cfg(not(unix))]
fn make(folder: &Path) -> std::io::Result<()> {
    fs::create_dir(folder)
}

/// Whether a folder is none that another user made for us.
#[cfg(unix)]
fn is_ours(folder: &Path) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    let own = nix::unistd::geteuid().as_raw();
    fs::symlink_metadata(folder).is_ok_and(|m| m.is_dir() && m.uid() == own)
}

#[cfg(not(unix))]
fn is_ours(folder: &Path) -> bool {
    fs::symlink_metadata(folder).is_ok_and(|m| m.is_dir())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::temp::Temp;

    #[test]
    fn a_scratch_folder_goes_away_unless_it_is_kept() {
        let base = Temp::new("scratch");
        let mut first = Scratch::open(Some(&base.0), "k").unwrap();
        fs::create_dir_all(first.inputs()).unwrap();
        assert!(matches!(Scratch::open(Some(&base.0), "k"), Err(JobError::Busy(_))));
        first.keep();
        drop(first);
        let second = Scratch::open(Some(&base.0), "k").unwrap();
        assert!(second.inputs().is_dir());
        drop(second);
        assert!(base.names().is_empty());
    }
}
