//! One process at a time works on a job.

use std::{
    fs::{self, File, OpenOptions, TryLockError},
    path::{Path, PathBuf},
};

use super::JobError;
use crate::io::open_plain;

/// Times that a lock is looked for whose file was removed by the one that held it.
const TRIES: usize = 16;

/// A lock on a file, which goes away with it. The system takes the lock of a process that was killed.
#[derive(Debug)]
pub struct Hold {
    path: PathBuf,
    _file: File,
}

impl Hold {
    /// Takes a lock; the folder around its file is made where it is missing.
    ///
    /// # Errors
    /// [`JobError::Busy`] where another process has it; a disk that refuses.
    pub fn take(path: PathBuf) -> Result<Self, JobError> {
        let fails = |source| JobError::Disk { path: path.clone(), source };
        fs::create_dir_all(path.parent().unwrap_or(Path::new("."))).map_err(fails)?;
        for _ in 0..TRIES {
            let file = open_plain(&path, OpenOptions::new().write(true).create(true)).map_err(fails)?;
            match file.try_lock() {
                Ok(()) if is_at(&file, &path) => return Ok(Self { path, _file: file }),
                // Who held it has removed the file since it was opened here: a new one is locked.
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Err(JobError::Busy(path)),
                Err(TryLockError::Error(source)) => return Err(fails(source)),
            }
        }
        Err(JobError::Busy(path))
    }
}

impl Drop for Hold {
    fn drop(&mut self) {
        // While the lock is held, so that nobody who finds the file takes it for a lock of his own.
        fs::remove_file(&self.path).ok();
    }
}

#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    let same = |a: fs::Metadata, b: fs::Metadata| (a.dev(), a.ino()) == (b.dev(), b.ino());
    file.metadata().is_ok_and(|a| fs::symlink_metadata(path).is_ok_and(|b| same(a, b)))
}

#[cfg(not(unix))]
fn is_at(_: &File, path: &Path) -> bool {
    path.exists()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::temp::Temp;

    #[test]
    fn a_lock_is_held_by_one_and_leaves_no_file() {
        let folder = Temp::new("hold");
        let path = folder.0.join("new/.job.lock");
        let first = Hold::take(path.clone()).unwrap();
        assert!(matches!(Hold::take(path.clone()), Err(JobError::Busy(_))));
        drop(first);
        assert!(!path.exists());
        drop(Hold::take(path).unwrap());
    }
}
