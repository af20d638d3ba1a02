//! The result of one stage in a file: a header (magic, version, digest of what it belongs to, length,
//! checksum) and the postcard bytes of the value.
//!
//! A file appears under its name only when whole. A damaged file counts as absent: the stage is
//! computed again. So nothing waits until the disk has it: what a power cut takes is computed again, too.
//!
//! Values go to the file and come from it piece by piece, so they are never twice in memory, and a file is
//! summed before any of it is decoded.

use std::{
    fs::{self, File, OpenOptions},
    hash::Hasher as _,
    io::{self, BufReader, BufWriter, Read, Seek as _, SeekFrom, Write},
    path::{Path, PathBuf},
    process,
};

use serde::{Serialize, de::DeserializeOwned};

use super::{
    Monitor,
    checkpoint_error::{CheckpointError, MAX_BYTES},
    least_bytes::RECONSTRUCTION,
};
use ::io::{create_plain, free_bytes, open_plain};
use common::note::{Note, NoteCode};
use geometry::bytes::PIECE_BYTES;
use twox_hash::XxHash64;

const MAGIC: [u8; 8] = *b"ARTITWIN";
const VERSION: u32 = 3;
/// Magic 8, version 4, digest 8, length 8, checksum 8.
pub(super) const HEADER_BYTES: usize = 36;
/// What is written or read at once, bytes.
const BUFFER_BYTES: usize = 1 << 20;
/// End of the name of a stage's file.
pub(super) const STAGE_FILE: &str = ".ckpt";

/// The name of a stage as part of that of a file.
///
/// # Errors
/// [`CheckpointError::StageName`].
pub(super) fn stage_name(stage: &str) -> Result<String, CheckpointError> {
    let valid = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "_-/".contains(c);
    if stage.is_empty() || stage.len() > 64 || !stage.chars().all(valid) {
        return Err(CheckpointError::StageName(stage.to_owned()));
    }
    Ok(stage.replace('/', "."))
}

/// Where the result of a stage is kept.
pub(super) struct StageFile<'a> {
    pub path: PathBuf,
    pub stage: &'a str,
    /// Of all that the result follows from.
    pub digest: u64,
}

impl StageFile<'_> {
    /// Writes the result; replaces an earlier one.
    ///
    /// # Errors
    /// If the value is too large, the disk refuses, or would have no room for the result of the run; an
    /// earlier result stays as it was then.
    pub(crate) fn save<T: Serialize>(&self, value: &T) -> Result<(), CheckpointError> {
        let folder = self.path.parent().unwrap_or(Path::new("."));
        let mut too_large = false;
        let written = write_whole(&self.path, |file| {
            // Filled in at the end, when length and checksum are known; zeros are no header.
            file.write_all(&[0; HEADER_BYTES])?;
            let mut payload = Summed { inner: &mut *file, sum: self.sum(), length: 0 };
            let outcome = postcard::to_io(value, &mut payload).map(|_| ()).map_err(io::Error::other);
            // Taken before `?`, as the writer's own error says only that it refused.
            too_large = payload.length > MAX_BYTES;
            outcome?;
            // What is kept is large, some 300 MB of frames; the result comes first.
            if free_bytes(folder).is_some_and(|free| free < RECONSTRUCTION) {
                return Err(io::ErrorKind::StorageFull.into());
            }
            let header = header(self.digest, payload.length, payload.sum.finish());
            file.seek(SeekFrom::Start(0))?;
            file.write_all(&header)
        });
        match written {
            Err(_) if too_large => Err(CheckpointError::TooLarge { stage: self.stage.to_owned() }),
            Err(source) => Err(CheckpointError::Disk { path: self.path.clone(), source }),
            Ok(()) => Ok(()),
        }
    }

    /// The result, if there is a whole one. Damage is reported to `monitor`.
    pub(crate) fn load<T: DeserializeOwned>(&self, monitor: &Monitor) -> Option<T> {
        match self.read() {
            Ok(value) => Some(value),
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            Err(error) => {
                let path = self.path.display();
                let stage = self.stage;
                let text = format!("checkpoint {path} cannot be used ({error}); {stage} is computed again");
                monitor.warn(&Note::new(NoteCode::StageComputedAgain, text));
                None
            }
        }
    }

    /// The checksum starts with what the bytes belong to, so that a renamed file is found out.
    pub(crate) fn sum(&self) -> XxHash64 {
        let mut sum = XxHash64::default();
        sum.write(&self.digest.to_le_bytes());
        sum.write(self.stage.as_bytes());
        sum
    }

    fn read<T: DeserializeOwned>(&self) -> io::Result<T> {
        let file = open_plain(&self.path, OpenOptions::new().read(true))?;
        if file.metadata()?.len() > MAX_BYTES + HEADER_BYTES as u64 {
            return Err(io::Error::other("too large"));
        }
        let mut file = BufReader::with_capacity(BUFFER_BYTES, file);
        let mut head = [0; HEADER_BYTES];
        file.read_exact(&mut head)?;
        // Summed before it is decoded: a damaged length could ask the decoder for any amount of memory.
        let mut summed = Summed { inner: io::sink(), sum: self.sum(), length: 0 };
        io::copy(&mut file, &mut summed)?;
        if head != header(self.digest, summed.length, summed.sum.finish()) {
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

pub(super) fn header(digest: u64, length: u64, checksum: u64) -> [u8; HEADER_BYTES] {
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
    sum: XxHash64,
    length: u64,
}

impl<W: Write> Write for Summed<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.length += bytes.len() as u64;
        if self.length > MAX_BYTES {
            return Err(io::Error::other("too large"));
        }
        self.inner.write_all(bytes)?;
        self.sum.write(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

/// Writes a file under a temporary name, then gives it its name.
pub(super) fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> io::Result<()> {
    // Of this process: others may write the same value to the same folder.
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
