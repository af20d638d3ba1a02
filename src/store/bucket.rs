//! A store as this program uses it.

use std::{io, ops::Range};

use super::StoreError;

/// What a store says of an object.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ObjectFacts {
    /// Its path in the bucket.
    pub path: String,
    /// Its bytes.
    pub bytes: u64,
    /// ETag and version, which change with the content; empty where the store gives neither.
    pub tag: String,
    /// ETag alone.
    pub etag: Option<String>,
}

/// What became of an object that was to be created.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Created {
    /// It is there now.
    New,
    /// One of its name was there before, and is as it was.
    Stood,
}

/// Takes the bytes of the range of this number.
pub type Sink<'a> = &'a mut dyn FnMut(usize, &[u8]) -> io::Result<()>;

/// A bucket, container or host. Requests that fail in a way that may pass are sent again, with waits that
/// grow.
pub trait Bucket {
    /// An object; `None` where there is none.
    ///
    /// # Errors
    /// [`StoreError::Access`].
    fn head(&self, path: &str) -> Result<Option<ObjectFacts>, StoreError>;

    /// All objects below a prefix, by path.
    ///
    /// # Errors
    /// [`StoreError::Access`]; [`StoreError::TooMany`] beyond `limit`.
    fn list(&self, prefix: &str, limit: usize) -> Result<Vec<ObjectFacts>, StoreError>;

    /// Ranges of an object that has not changed since, some at a time, handed out in their order.
    ///
    /// # Errors
    /// [`StoreError::Access`], also where it has changed; [`StoreError::Scratch`] for that of the sink.
    fn ranges(&self, object: &ObjectFacts, ranges: &[Range<u64>], sink: Sink) -> Result<(), StoreError>;

    /// Writes objects that are not there yet, each whole, some at a time.
    ///
    /// # Errors
    /// [`StoreError::Access`].
    fn create(&self, objects: Vec<(String, Vec<u8>)>) -> Result<Vec<Created>, StoreError>;

    /// An object of at most `limit` bytes; `None` where there is none.
    ///
    /// # Errors
    /// [`StoreError::Access`], [`StoreError::TooLarge`].
    fn get(&self, path: &str, limit: u64) -> Result<Option<Vec<u8>>, StoreError>;
}
