//! Bytes that are read by their place, wherever they lie.

use std::{
    fs::File,
    io::{self, Read as _, Seek as _, SeekFrom},
    ops::Range,
    path::Path,
};

/// Something of so many bytes, any of which can be read.
pub trait Ranges {
    /// All bytes.
    fn size(&self) -> u64;

    /// Bytes from `start` on, `count` of them.
    ///
    /// # Errors
    /// Where they cannot be had, or there are fewer.
    fn range(&self, start: u64, count: u64) -> io::Result<Vec<u8>>;

    /// Bytes of several ranges, which a store gives some at a time.
    ///
    /// # Errors
    /// As [`Self::range`].
    fn many(&self, ranges: &[Range<u64>]) -> io::Result<Vec<Vec<u8>>> {
        ranges.iter().map(|r| self.range(r.start, r.end - r.start)).collect()
    }
}

/// What an excerpt of a file consists of, one behind the other.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Piece {
    /// Bytes of the file.
    Stored(Range<u64>),
    /// Others.
    Made(Vec<u8>),
}

/// Bytes of what the pieces take from the file.
#[must_use]
pub fn stored_bytes(pieces: &[Piece]) -> u64 {
    let bytes = |p: &Piece| if let Piece::Stored(range) = p { range.end - range.start } else { 0 };
    pieces.iter().map(bytes).sum()
}

/// A file of this machine.
pub struct FileRanges {
    file: File,
    size: u64,
}

impl FileRanges {
    /// Opens a file.
    ///
    /// # Errors
    /// As [`crate::files::open`].
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = crate::files::open(path)?;
        Ok(Self { size: file.metadata()?.len(), file })
    }
}

impl Ranges for FileRanges {
    fn size(&self) -> u64 {
        self.size
    }

    fn range(&self, start: u64, count: u64) -> io::Result<Vec<u8>> {
        let mut file = &self.file;
        file.seek(SeekFrom::Start(start))?;
        let mut bytes = Vec::new();
        // Grows with what comes, as `count` may be a claim of the file.
        file.take(count).read_to_end(&mut bytes)?;
        if (bytes.len() as u64) < count { Err(io::ErrorKind::UnexpectedEof.into()) } else { Ok(bytes) }
    }
}
