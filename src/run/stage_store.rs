//! Keeps results of stages in a folder, each under the digest of its inputs.
//!
//! A file has a header (magic with the version of the format, checksum) and the postcard bytes of the value,
//! and appears under its name only when complete. A damaged file counts as missing, and the stage is computed
//! again. Therefore no write waits for the disk: results lost in a power cut are computed again. Values are
//! written and read piece by piece, so they are never in memory twice, and a file's checksum is verified
//! before any of it is decoded.
//!
//! Several processes may read and write one folder: files of the same name have the same content.

use std::{
    fs::{self, File, OpenOptions},
    hash::Hasher as _,
    io::{self, BufReader, BufWriter, Read, Seek as _, SeekFrom, Write},
    path::{Path, PathBuf},
    process,
};

use serde::{Serialize, de::DeserializeOwned};

use super::{CheckpointError, Fingerprint, Monitor, least_bytes::RECONSTRUCTION, stage_facts::of_stage};
use ::io::{create_plain, free_bytes, open_plain};
use common::note::{Note, NoteCode};
use geometry::bytes::PIECE_BYTES;
use twox_hash::XxHash64;

/// The last byte is the version of the format.
const MAGIC: [u8; 8] = *b"ARTITWN\x04";
/// 8 bytes of magic, 8 of checksum.
pub(super) const HEADER_BYTES: usize = 16;
/// Buffer for writing and reading, bytes.
const BUFFER_BYTES: usize = 1 << 20;
/// Extension of the files.
pub(super) const ENDING: &str = ".ckpt";

/// A folder of results, for one run.
#[derive(Debug)]
pub struct StageStore {
    folder: PathBuf,
    facts: Fingerprint,
}

impl StageStore {
    /// Opens the folder for a run with these facts, and creates it if it is missing.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn open(folder: &Path, facts: Fingerprint) -> Result<Self, CheckpointError> {
        fs::create_dir_all(folder)
            .map_err(|source| CheckpointError::Disk { path: folder.to_owned(), source })?;
        Ok(Self { folder: folder.to_owned(), facts })
    }

    /// Path of the folder.
    pub fn path(&self) -> &Path {
        &self.folder
    }

    /// Writes the result of a stage; replaces an earlier one.
    ///
    /// # Errors
    /// If the disk refuses, or would have no room left for the result of the run; an earlier result then
    /// stays.
    pub fn save<T: Serialize>(&self, stage: &str, value: &T) -> Result<(), CheckpointError> {
        let (path, sum) = self.file(stage);
        write_whole(&path, |file| {
            // Filled in at the end, when the checksum is known; zeros are no header.
            file.write_all(&[0; HEADER_BYTES])?;
            let payload = Summed { inner: &mut *file, sum };
            let payload = postcard::to_io(value, payload).map_err(io::Error::other)?;
            let header = header(&payload.sum);
            // Kept files are large, e.g. 300 MB of frames; the result of the run has priority.
            if free_bytes(&self.folder).is_some_and(|free| free < RECONSTRUCTION) {
                return Err(io::ErrorKind::StorageFull.into());
            }
            file.seek(SeekFrom::Start(0))?;
            file.write_all(&header)
        })
        .map_err(|source| CheckpointError::Disk { path, source })
    }

    /// The result of a stage, if there is a complete one. Damage is reported to `monitor`.
    pub fn load<T: DeserializeOwned>(&self, stage: &str, monitor: &Monitor) -> Option<T> {
        let (path, sum) = self.file(stage);
        match read(&path, sum) {
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

    /// The file of a stage's result, and the beginning of its checksum: the digest of its inputs, so a
    /// renamed file is detected.
    fn file(&self, stage: &str) -> (PathBuf, XxHash64) {
        let key = of_stage(&self.facts, stage).key(stage).to_string();
        let mut sum = XxHash64::default();
        sum.write(key.as_bytes());
        (self.folder.join(key + ENDING), sum)
    }
}

fn read<T: DeserializeOwned>(path: &Path, sum: XxHash64) -> io::Result<T> {
    let file = open_plain(path, OpenOptions::new().read(true))?;
    let mut file = BufReader::with_capacity(BUFFER_BYTES, file);
    let mut head = [0; HEADER_BYTES];
    file.read_exact(&mut head)?;
    // Verified before decoding: a damaged length could make the decoder request any amount of memory.
    let mut summed = Summed { inner: io::sink(), sum };
    io::copy(&mut file, &mut summed)?;
    if head != header(&summed.sum) {
        return Err(io::Error::other("damaged, or of another run or version"));
    }
    file.seek(SeekFrom::Start(HEADER_BYTES as u64))?;
    // Longer pieces and texts are never written.
    let mut piece = vec![0; PIECE_BYTES];
    let (value, (mut rest, _)) = postcard::from_io((file, &mut piece)).map_err(io::Error::other)?;
    // More bytes than the type needs: another type was written.
    if rest.read(&mut [0])? > 0 {
        return Err(io::Error::other("holds more than was asked for"));
    }
    Ok(value)
}

fn header(sum: &XxHash64) -> [u8; HEADER_BYTES] {
    let mut header = [0; HEADER_BYTES];
    header[..8].copy_from_slice(&MAGIC);
    header[8..].copy_from_slice(&sum.finish().to_le_bytes());
    header
}

/// Computes the checksum of the bytes that pass.
struct Summed<W> {
    inner: W,
    sum: XxHash64,
}

impl<W: Write> Write for Summed<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.inner.write_all(bytes)?;
        self.sum.write(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

/// Writes a file under a temporary name, then renames it.
fn write_whole(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> io::Result<()> {
    // With the process id: other processes may write the same value to the same folder.
    let temporary = path.with_extension(format!("{}.tmp", process::id()));
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

#[cfg(test)]
#[path = "stage_store_tests.rs"]
mod tests;
