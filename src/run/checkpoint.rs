//! What a stopped run leaves in its output folder so that it can be continued: a store of its own, held by
//! one process at a time.
//!
//! A folder that contains links or foreign files is refused.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use super::{
    Fingerprint, Monitor,
    stage_store::{ENDING, StageStore},
};
use ::io::LockedFile;

const LOCK_FILE: &str = "lock";
/// Name of the facts about the run itself, under a key that does not depend on the run.
const FACTS: &str = "fingerprint";

/// Why results of stages cannot be kept or used.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// The checkpoint is of another run.
    #[error(
        "{} belongs to another run; give the same inputs and settings, or start anew without --resume: {}",
        folder.display(),
        differences.join("; ")
    )]
    OtherRun {
        /// The checkpoint folder.
        folder: PathBuf,
        /// Sentences about the differences.
        differences: Vec<String>,
    },
    /// Another process works on the same run.
    #[error("another run is writing to {}; wait for it, or give another --name or --out", folder.display())]
    InUse {
        /// The checkpoint folder.
        folder: PathBuf,
    },
    /// The folder is not a checkpoint, or contains something else.
    #[error(
        "{} is a link, or not of a checkpoint of artitwin; move it away or give another --name",
        path.display()
    )]
    Foreign {
        /// The folder, or a file in it.
        path: PathBuf,
    },
    /// The disk refused an operation.
    #[error("checkpoint {}", path.display())]
    Disk {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

/// The checkpoint of one run.
#[derive(Debug)]
pub struct Checkpoint {
    /// Results of its stages.
    pub store: StageStore,
    continued: bool,
    /// Whether the folder around it was created for it.
    made_parent: bool,
    _lock: LockedFile,
}

impl Checkpoint {
    /// Name of the checkpoint folder of a run called `name` in `out`.
    pub fn folder(out: &Path, name: &str) -> PathBuf {
        out.join(format!(".artitwin-{name}.checkpoint"))
    }

    /// Opens or creates a checkpoint folder. Without `resume`, what an earlier run left is deleted.
    ///
    /// # Errors
    /// If the checkpoint is of a run with another fingerprint and `resume` is asked for, if another process
    /// holds it, if the folder is no checkpoint, or the disk refuses.
    pub fn open(folder: &Path, fingerprint: &Fingerprint, resume: bool) -> Result<Self, CheckpointError> {
        let fails = |source| CheckpointError::Disk { path: folder.to_owned(), source };
        let made_parent = folder.parent().is_some_and(|out| !out.as_os_str().is_empty() && !out.exists());
        // Through a link, all stages would be written to its target.
        if fs::symlink_metadata(folder).is_ok_and(|found| !found.is_dir()) {
            return Err(CheckpointError::Foreign { path: folder.to_owned() });
        }
        let of_any_run = StageStore::open(folder, Fingerprint::default())?;
        // Checked before the lock is created, which would make a foreign folder look like ours.
        if let Some(path) = foreign(folder).map_err(fails)? {
            return Err(CheckpointError::Foreign { path });
        }
        let lock = LockedFile::take(&folder.join(LOCK_FILE)).map_err(fails)?;
        let lock = lock.ok_or_else(|| CheckpointError::InUse { folder: folder.to_owned() })?;
        // Under the lock: nobody writes it meanwhile.
        let earlier: Option<Fingerprint> = of_any_run.load(FACTS, &Monitor::silent());
        if let Some(earlier) = earlier.as_ref().filter(|e| resume && *e != fingerprint) {
            let differences = fingerprint.differences(earlier);
            return Err(CheckpointError::OtherRun { folder: folder.to_owned(), differences });
        }
        let continued = resume && earlier.is_some();
        // A file that a killed run was writing is of no use.
        remove_files(folder, |name| !continued || name.ends_with(".tmp")).map_err(fails)?;
        if !continued {
            of_any_run.save(FACTS, fingerprint)?;
        }
        let store = StageStore::open(folder, fingerprint.clone())?;
        Ok(Self { store, continued, made_parent, _lock: lock })
    }

    /// Whether an earlier run is continued.
    pub fn is_continued(&self) -> bool {
        self.continued
    }

    /// Sum of the sizes of all kept results, bytes.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn bytes(&self) -> io::Result<u64> {
        let files = own_files(self.store.path())?.into_iter();
        let results = files.filter(|name| name.ends_with(ENDING) && !name.starts_with(FACTS));
        results.map(|name| Ok(fs::symlink_metadata(self.store.path().join(name))?.len())).sum()
    }

    /// Deletes the checkpoint: the run is complete.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn remove(self) -> Result<(), CheckpointError> {
        let folder = self.store.path();
        remove_files(folder, |_| true)
            // The lock is deleted last: until then the folder is ours.
            .and_then(|()| fs::remove_file(folder.join(LOCK_FILE)))
            .and_then(|()| fs::remove_dir(folder))
            .map_err(|source| CheckpointError::Disk { path: folder.to_owned(), source })
    }

    /// Deletes the checkpoint of a failed run, and the folder around it if it was made for it and holds
    /// nothing else.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn discard(self) -> Result<(), CheckpointError> {
        let made = self.store.path().parent().filter(|_| self.made_parent).map(Path::to_owned);
        self.remove()?;
        // A folder with other files stays.
        made.into_iter().for_each(|out| fs::remove_dir(out).unwrap_or_default());
        Ok(())
    }
}

/// Whether this program or an earlier version wrote a file; nothing else is ever deleted.
fn is_ours(name: &str) -> bool {
    name.ends_with(ENDING) || name.ends_with(".tmp") || name == "fingerprint.json"
}

/// Names of this program's files, without the lock.
fn own_files(folder: &Path) -> io::Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder)? {
        names.push(entry?.file_name().to_string_lossy().into_owned());
    }
    names.retain(|name| is_ours(name));
    Ok(names)
}

fn remove_files(folder: &Path, which: impl Fn(&String) -> bool) -> io::Result<()> {
    own_files(folder)?
        .iter()
        .filter(|name| which(name))
        .try_for_each(|name| fs::remove_file(folder.join(name)))
}

/// A foreign entry of a checkpoint folder; the folder itself, if it has entries but no lock.
fn foreign(folder: &Path) -> io::Result<Option<PathBuf>> {
    let entries: Vec<fs::DirEntry> = fs::read_dir(folder)?.collect::<io::Result<_>>()?;
    for entry in &entries {
        let name = entry.file_name();
        let is_known = name == LOCK_FILE || is_ours(&name.to_string_lossy());
        if !is_known || !entry.file_type()?.is_file() {
            return Ok(Some(entry.path()));
        }
    }
    // A folder with the right names but without a lock was not made here.
    let locked = entries.is_empty() || entries.iter().any(|entry| entry.file_name() == LOCK_FILE);
    Ok((!locked).then(|| folder.to_owned()))
}

#[cfg(test)]
#[path = "checkpoint_tests.rs"]
mod tests;
