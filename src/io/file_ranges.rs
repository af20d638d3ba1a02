//! Reads any range of bytes of a file.

use std::{
    fs::File,
    io::{self, Read as _, Seek as _, SeekFrom},
    path::Path,
};

/// An open file and its size.
pub struct FileRanges {
    file: File,
    size: u64,
}

impl FileRanges {
    /// Opens a file.
    ///
    /// # Errors
    /// As [`common::files::open`].
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = common::files::open_regular(path)?;
        Ok(Self { size: file.metadata()?.len(), file })
    }

    /// Size of the file, bytes.
    #[must_use]
    pub fn size(&self) -> u64 {
        self.size
    }

    /// Reads `count` bytes from `start` on.
    ///
    /// # Errors
    /// If they cannot be read, or there are fewer.
    pub fn range(&self, start: u64, count: u64) -> io::Result<Vec<u8>> {
        let mut file = &self.file;
        file.seek(SeekFrom::Start(start))?;
        let mut bytes = Vec::new();
        // Grows with the bytes read, as `count` may be a claim of the file.
        file.take(count).read_to_end(&mut bytes)?;
        if (bytes.len() as u64) < count { Err(io::ErrorKind::UnexpectedEof.into()) } else { Ok(bytes) }
    }
}
