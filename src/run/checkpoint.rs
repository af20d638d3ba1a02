//! Results of finished stages on disk, so that a stopped run continues where it was.
//!
//! One file per stage: a header (magic, version, fingerprint, length, checksum) and the postcard bytes of the
//! value. A file appears under its name only when whole. A damaged file counts as absent: the stage is
//! computed again. So nothing waits until the disk has it: what a power cut takes is computed again, too.
//!
//! Values go to the file and come from it piece by piece, so they are never twice in memory, and a file is
//! summed before any of it is decoded. A folder with a link in it, or with what was not written here, is
//! refused.

use std::{
    fs::{self, File, OpenOptions, TryLockError},
    io::{self, BufReader, BufWriter, Read, Seek as _, SeekFrom, Write},
    path::{Path, PathBuf},
};

use serde::{Serialize, de::DeserializeOwned};

use super::{Fingerprint, Monitor, checksum::Checksum, least_bytes::RECONSTRUCTION};
use crate::{
    geometry::bytes::PIECE_BYTES,
    io::{create_plain, free_bytes, open_plain},
    note::{Note, NoteCode},
};

const MAGIC: [u8; 8] = *b"ARTITWIN";
const VERSION: u32 = 2;
/// Magic 8, version 4, fingerprint 8, length 8, checksum 8.
const HEADER_BYTES: usize = 36;
/// Largest value of one stage, bytes: 16 states of 80 color and depth images of 1280 x 720 pixels each.
const MAX_BYTES: u64 = 16 << 30;
/// End of the name of a stage's file.
const STAGE_FILE: &str = ".ckpt";
/// Largest fingerprint file, bytes.
const MAX_FINGERPRINT_BYTES: u64 = 1 << 20;
/// What is written or read at once, bytes.
const BUFFER_BYTES: usize = 1 << 20;
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
    /// The lock lasts as long as this file is open.
    _lock: File,
}

/// Why a checkpoint cannot be used or written.
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
        /// Sentences about what differs.
        differences: Vec<String>,
    },
    /// Another process works on the same run.
    #[error("another run is writing to {}; wait for it, or give another --name or --out", folder.display())]
    InUse {
        /// The checkpoint folder.
        folder: PathBuf,
    },
    /// The folder is something else, or holds something else.
    #[error(
        "{} is a link, or not of a checkpoint of artitwin; move it away or give another --name",
        path.display()
    )]
    Foreign {
        /// The folder, or what is in it.
        path: PathBuf,
    },
    /// A stage has no valid name.
    #[error("stage name {0:?}: use a-z, 0-9, '_', '-' and '/'")]
    StageName(String),
    /// The value is larger than a checkpoint may be.
    #[error("stage {stage} is larger than {MAX_BYTES} bytes")]
    TooLarge {
        /// Name of the stage.
        stage: String,
    },
    /// The disk refused.
    #[error("checkpoint {}", path.display())]
    Disk {
        /// File or folder.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
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
        let lock = open_plain(&folder.join(LOCK_FILE), OpenOptions::new().write(true).create(true))
            .map_err(fails)?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(CheckpointError::InUse { folder: folder.to_owned() });
            }
            Err(TryLockError::Error(source)) => return Err(fails(source)),
        }
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
        let path = self.file(stage)?;
        let mut too_large = false;
        let written = write_whole(&path, |file| {
            // Filled in at the end, when length and checksum are known; zeros are no header.
            file.write_all(&[0; HEADER_BYTES])?;
            let mut payload = Summed { inner: &mut *file, sum: self.sum(stage), length: 0 };
            let outcome = postcard::to_io(value, &mut payload).map(|_| ()).map_err(io::Error::other);
            // Taken before `?`, as the writer's own error says only that it refused.
            too_large = payload.length > MAX_BYTES;
            outcome?;
            // What is kept is large, some 300 MB of frames; the result comes first.
            if free_bytes(&self.folder).is_some_and(|free| free < RECONSTRUCTION) {
                return Err(io::ErrorKind::StorageFull.into());
            }
            let header = header(self.digest, payload.length, payload.sum.value());
            file.seek(SeekFrom::Start(0))?;
            file.write_all(&header)
        });
        match written {
            Err(_) if too_large => Err(CheckpointError::TooLarge { stage: stage.to_owned() }),
            Err(source) => Err(CheckpointError::Disk { path, source }),
            Ok(()) => Ok(()),
        }
    }

    /// The result of a stage, if there is a whole one. Damage is reported to `monitor`.
    pub fn load<T: DeserializeOwned>(&self, stage: &str, monitor: &Monitor) -> Option<T> {
        let path = self.file(stage).ok()?;
        match self.read(stage, &path) {
            Ok(value) => Some(value),
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            Err(error) => {
                let path = path.display();
                let text = format!("checkpoint {path} cannot be used ({error}); {stage} is computed again");
                monitor.warn(&Note::new(NoteCode::StageComputedAgain, text));
                None
            }
        }
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

    fn file(&self, stage: &str) -> Result<PathBuf, CheckpointError> {
        let valid = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "_-/".contains(c);
        if stage.is_empty() || stage.len() > 64 || !stage.chars().all(valid) {
            return Err(CheckpointError::StageName(stage.to_owned()));
        }
        Ok(self.folder.join(stage.replace('/', ".") + STAGE_FILE))
    }

    /// The checksum starts with what the bytes belong to, so that a renamed file is found out.
    fn sum(&self, stage: &str) -> Checksum {
        let mut sum = Checksum::default();
        sum.update(&self.digest.to_le_bytes());
        sum.update(stage.as_bytes());
        sum
    }

    fn read<T: DeserializeOwned>(&self, stage: &str, path: &Path) -> io::Result<T> {
        let file = open_plain(path, OpenOptions::new().read(true))?;
        if file.metadata()?.len() > MAX_BYTES + HEADER_BYTES as u64 {
            return Err(io::Error::other("too large"));
        }
        let mut file = BufReader::with_capacity(BUFFER_BYTES, file);
        let mut head = [0; HEADER_BYTES];
        file.read_exact(&mut head)?;
        // Summed before it is decoded: a damaged length could ask the decoder for any amount of memory.
        let mut summed = Summed { inner: io::sink(), sum: self.sum(stage), length: 0 };
        io::copy(&mut file, &mut summed)?;
        if head != header(self.digest, summed.length, summed.sum.value()) {
            return Err(io::Error::other("damaged, or of another run or version"));
        }
        file.seek(SeekFrom::Start(HEADER_BYTES as u64))?;
        // Longer pieces and texts are not written.
        let mut piece = vec![0; PIECE_BYTES];
        let (value, (mut rest, _)) = postcard::from_io((file, &mut piece)).map_err(io::Error::other)?;
        // More bytes than the type takes: another type was written.
        if rest.read(&mut [0])? > 0 {
            return Err(io::Error::other("holds more than was asked for"));
        }
        Ok(value)
    }
}

fn header(digest: u64, length: u64, checksum: u64) -> [u8; HEADER_BYTES] {
    let mut header = [0; HEADER_BYTES];
    header[..8].copy_from_slice(&MAGIC);
    header[8..12].copy_from_slice(&VERSION.to_le_bytes());
    for (slot, value) in header[12..].chunks_exact_mut(8).zip([digest, length, checksum]) {
        slot.copy_from_slice(&value.to_le_bytes());
    }
    header
}

/// Counts and sums what passes; refuses more than [`MAX_BYTES`].
struct Summed<W> {
    inner: W,
    sum: Checksum,
    length: u64,
}

impl<W: Write> Write for Summed<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.length += bytes.len() as u64;
        if self.length > MAX_BYTES {
            return Err(io::Error::other("too large"));
        }
        self.inner.write_all(bytes)?;
        self.sum.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

/// Writes a file under a temporary name, then gives it its name.
fn write_whole(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> io::Result<()> {
    let temporary = path.with_extension("tmp");
    let written = create_plain(&temporary).and_then(|file| {
        let mut file = BufWriter::with_capacity(BUFFER_BYTES, file);
        write(&mut file)?;
        file.into_inner().map_err(io::IntoInnerError::into_error).map(drop)
    });
    match written {
        Ok(()) => fs::rename(&temporary, path),
        Err(error) => {
            fs::remove_file(&temporary).ok();
            Err(error)
        }
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
