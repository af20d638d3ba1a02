//! A lock file: one process at a time.

use std::{
    fs::{File, OpenOptions, TryLockError},
    io,
    path::Path,
};

use super::open_plain;

/// A file with one owner at a time. The system releases the lock of a killed process, whereas a marker file
/// would remain.
#[derive(Debug)]
pub struct LockedFile(File);

impl LockedFile {
    /// Locks the file at `path` and creates it if it is missing; `None` while another owner holds it.
    ///
    /// # Errors
    /// If it is no plain file or the disk refuses.
    pub fn take(path: &Path) -> io::Result<Option<Self>> {
        let file = open_plain(path, OpenOptions::new().write(true).create(true).truncate(false))?;
        match file.try_lock() {
            Ok(()) => Ok(Some(Self(file))),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(source)) => Err(source),
        }
    }
}

impl Drop for LockedFile {
    /// Closing alone is not enough: a process just started by another thread has a copy of the file until its
    /// program is loaded, and a lock lasts as long as the last copy.
    fn drop(&mut self) {
        self.0.unlock().ok();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dropped_lock_is_free_although_a_copy_of_its_file_is_open() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        let first = LockedFile::take(&path).unwrap().unwrap();
        let copy = first.0.try_clone().unwrap();
        assert!(LockedFile::take(&path).unwrap().is_none());
        drop(first);
        assert!(LockedFile::take(&path).unwrap().is_some());
        drop(copy);
    }
}
