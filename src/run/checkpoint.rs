//! Results of finished stages on disk, so that a stopped run continues where it was.
//!
//! One file per stage (`stage_file.rs`). A folder with a link in it, or with what was not written here, is
//! refused.

use std::{
    fs::{self, File, OpenOptions},
    io::{self, BufReader, BufWriter, Read as _},
    path::{Path, PathBuf},
};

use serde::{Serialize, de::DeserializeOwned};

use super::{
    Fingerprint, Monitor,
    checkpoint_error::CheckpointError,
    stage_file::{STAGE_FILE, StageFile, stage_name, write_whole},
};
use ::io::{LockedFile, open_plain};

/// Largest fingerprint file, bytes.
const MAX_FINGERPRINT_BYTES: u64 = 1 << 20;
const FINGERPRINT_FILE: &str = "fingerprint.json";
const LOCK_FILE: &str = "lock";

/// The checkpoint folder of one run. Held by one process at a time.
#[derive(Debug)]
pub struct Checkpoint {
    folder: PathBuf,
    digest: u64,
    continued: bool,
    /// Whether the folder around it was made for it.
    made_parent: bool,
    _lock: LockedFile,
}

impl Checkpoint {
    /// Name of the checkpoint folder of a run called `name` in `out`.
    #[must_use]
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
        // A link would have all stages written to where it leads.
        if fs::symlink_metadata(folder).is_ok_and(|found| !found.is_dir()) {
            return Err(CheckpointError::Foreign { path: folder.to_owned() });
        }
        fs::create_dir_all(folder).map_err(fails)?;
        // Before the lock is made: with a lock in it, a folder of somebody else would count as one of ours.
        if let Some(path) = foreign(folder).map_err(fails)? {
            return Err(CheckpointError::Foreign { path });
        }
        let lock = LockedFile::take(&folder.join(LOCK_FILE)).map_err(fails)?;
        let lock = lock.ok_or_else(|| CheckpointError::InUse { folder: folder.to_owned() })?;
        // Under the lock, so that nobody writes it meanwhile.
        let earlier = read_fingerprint(&folder.join(FINGERPRINT_FILE));
        if let Some(earlier) = earlier.as_ref().filter(|e| resume && *e != fingerprint) {
            let differences = fingerprint.differences(earlier);
            return Err(CheckpointError::OtherRun { folder: folder.to_owned(), differences });
        }
        let continued = resume && earlier.is_some();
        // What a killed run was writing is of no use either way.
        let useless = |name: &&String| is_ours(name) && (!continued || name.ends_with(".tmp"));
        for name in file_names(folder).map_err(fails)?.iter().filter(useless) {
            fs::remove_file(folder.join(name)).map_err(fails)?;
        }
        if !continued {
            let write = |file: &mut BufWriter<File>| {
                serde_json::to_writer_pretty(file, fingerprint).map_err(io::Error::from)
            };
            write_whole(&folder.join(FINGERPRINT_FILE), write).map_err(fails)?;
        }
        Ok(Self {
            folder: folder.to_owned(),
            digest: fingerprint.digest(),
            continued,
            made_parent,
            _lock: lock,
        })
    }

    /// Whether an earlier run is continued.
    #[must_use]
    pub fn is_continued(&self) -> bool {
        self.continued
    }

    /// Writes the result of a stage; replaces an earlier one.
    ///
    /// # Errors
    /// If the name is not valid, the value is too large, the disk refuses, or would have no room for the
    /// result of the run; an earlier result stays as it
    /// was then.
    pub fn save<T: Serialize>(&self, stage: &str, value: &T) -> Result<(), CheckpointError> {
        self.file(stage)?.save(value)
    }

    /// The result of a stage, if there is a whole one. Damage is reported to `monitor`.
    pub fn load<T: DeserializeOwned>(&self, stage: &str, monitor: &Monitor) -> Option<T> {
        self.file(stage).ok()?.load(monitor)
    }

    /// Sum of the sizes of all results that are kept, bytes.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn bytes(&self) -> io::Result<u64> {
        let stages = file_names(&self.folder)?.into_iter().filter(|name| name.ends_with(STAGE_FILE));
        stages.map(|name| Ok(fs::symlink_metadata(self.folder.join(name))?.len())).sum()
    }

    /// Where it lies.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.folder
    }

    /// Deletes the checkpoint: the run is complete.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn remove(self) -> Result<(), CheckpointError> {
        let fails = |source| CheckpointError::Disk { path: self.folder.clone(), source };
        for name in file_names(&self.folder).map_err(fails)?.iter().filter(|n| is_ours(n)) {
            fs::remove_file(self.folder.join(name)).map_err(fails)?;
        }
        // The lock last: until then the folder is ours.
        fs::remove_file(self.folder.join(LOCK_FILE)).map_err(fails)?;
        fs::remove_dir(&self.folder).map_err(fails)
    }

    /// Deletes the checkpoint of a run that failed, and the folder around it if it was made for it and holds
    /// nothing else.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn discard(self) -> Result<(), CheckpointError> {
        let made = self.folder.parent().filter(|_| self.made_parent).map(Path::to_owned);
        self.remove()?;
        // A folder that holds something else stays.
        made.into_iter().for_each(|out| fs::remove_dir(out).unwrap_or_default());
        Ok(())
    }

    fn file<'a>(&self, stage: &'a str) -> Result<StageFile<'a>, CheckpointError> {
        let name = stage_name(stage)? + STAGE_FILE;
        Ok(StageFile { path: self.folder.join(name), stage, digest: self.digest })
    }
}

fn read_fingerprint(path: &Path) -> Option<Fingerprint> {
    let file = open_plain(path, OpenOptions::new().read(true)).ok()?;
    serde_json::from_reader(BufReader::new(file.take(MAX_FINGERPRINT_BYTES))).ok()
}

fn file_names(folder: &Path) -> io::Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder)? {
        names.push(entry?.file_name().to_string_lossy().into_owned());
    }
    names.sort();
    Ok(names)
}

/// Something in a checkpoint folder that was not put there by this program; the folder itself, if it holds
/// things and no lock.
fn foreign(folder: &Path) -> io::Result<Option<PathBuf>> {
    let entries: Vec<fs::DirEntry> = fs::read_dir(folder)?.collect::<io::Result<_>>()?;
    let is_lock = |entry: &fs::DirEntry| entry.file_name() == LOCK_FILE;
    for entry in &entries {
        let known = is_lock(entry) || is_ours(&entry.file_name().to_string_lossy());
        if !known || !entry.file_type()?.is_file() {
            return Ok(Some(entry.path()));
        }
    }
    // A folder with the right names but without a lock was not made here.
    let locked = entries.is_empty() || entries.iter().any(is_lock);
    Ok((!locked).then(|| folder.to_owned()))
}

/// Whether a file was written here; nothing else is ever deleted.
fn is_ours(name: &str) -> bool {
    name == FINGERPRINT_FILE || name.ends_with(STAGE_FILE) || name.ends_with(".tmp")
}

#[cfg(test)]
#[path = "checkpoint_tests.rs"]
mod tests;
