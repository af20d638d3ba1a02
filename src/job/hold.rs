//! One process at a time works on a job.

use std::{
    fs,
    path::{Path, PathBuf},
};

use super::JobError;
use crate::io::LockedFile;

/// Times that a lock is looked for whose file was removed by the one that held it.
const TRIES: usize = 16;

/// A lock on a file, which goes away with it.
#[derive(Debug)]
pub struct Hold {
    path: PathBuf,
    _file: LockedFile,
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
            match LockedFile::take(&path).map_err(fails)? {
                Some(file) if file.is_at(&path) => return Ok(Self { path, _file: file }),
                // Who held it has removed the file since it was opened here: a new one is locked.
                Some(_) => {}
                None => break,
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
