//! A lock that lets one node at a time use a session folder.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use ::io::LockedFile;

const LOCK_FILE: &str = ".node.lock";

/// Lock on a session folder; released when dropped, or when the process ends.
#[derive(Debug)]
pub(crate) struct SessionLock {
    folder: PathBuf,
    _file: LockedFile,
}

/// Why a session folder cannot be locked.
#[derive(Debug, thiserror::Error)]
pub enum SessionLockError {
    /// Another process holds the lock.
    #[error("another node works on the session {}; end it, or give another session or \
        out_folder", .0.display())]
    InUse(PathBuf),
    /// The operating system reports an error.
    #[error("the session {} cannot be used; give an out_folder that can be written to", folder.display())]
    Disk {
        /// Folder of the session.
        folder: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
}

impl SessionLock {
    /// Locks a session folder; creates it if it does not exist.
    ///
    /// # Errors
    /// If another process holds the lock or the disk reports an error.
    pub(crate) fn take(folder: &Path) -> Result<Self, SessionLockError> {
        let fails = |source| SessionLockError::Disk { folder: folder.to_owned(), source };
        fs::create_dir_all(folder).map_err(fails)?;
        let file = LockedFile::take(&folder.join(LOCK_FILE)).map_err(fails)?;
        let file = file.ok_or_else(|| SessionLockError::InUse(folder.to_owned()))?;
        Ok(Self { folder: folder.to_owned(), _file: file })
    }
}

impl Drop for SessionLock {
    /// A session without kept views leaves no folder.
    fn drop(&mut self) {
        let names = fs::read_dir(&self.folder)
            .map(|entries| entries.flatten().map(|e| e.file_name()).collect::<Vec<_>>());
        if names.is_ok_and(|names| names == [LOCK_FILE]) {
            fs::remove_file(self.folder.join(LOCK_FILE)).ok();
            fs::remove_dir(&self.folder).ok();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("artitwin-session-{name}-{}", std::process::id()));
        fs::remove_dir_all(&folder).ok();
        folder
    }

    #[test]
    fn a_session_has_one_node() {
        let folder = folder("lock");
        let first = SessionLock::take(&folder).unwrap();
        let refused = SessionLock::take(&folder).unwrap_err().to_string();
        assert!(
            refused.contains("another node") && refused.contains(&folder.display().to_string()),
            "{refused}"
        );
        drop(first);
        assert!(!folder.exists(), "nothing was kept");
        let again = SessionLock::take(&folder).unwrap();
        fs::write(folder.join("state0"), "").unwrap();
        drop(again);
        assert!(folder.join("state0").exists());
        SessionLock::take(&folder).unwrap();
        fs::remove_dir_all(&folder).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn a_link_in_place_of_the_lock_is_refused() {
        let folder = folder("link");
        fs::create_dir_all(&folder).unwrap();
        let precious = folder.join("precious");
        fs::write(&precious, "text").unwrap();
        std::os::unix::fs::symlink(&precious, folder.join(LOCK_FILE)).unwrap();
        assert!(matches!(SessionLock::take(&folder), Err(SessionLockError::Disk { .. })));
        assert_eq!(fs::read_to_string(&precious).unwrap(), "text");
        fs::remove_dir_all(&folder).unwrap();
    }
}
