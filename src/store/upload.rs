//! A result folder put into a store, an object a file.

use std::{fs, path::Path};

use serde::Serialize;
use sha2::{Digest as _, Sha256};

use super::{Bucket, Created, StoreError};
use crate::io::hex;

/// Bytes of the files that are in memory at a time, beside the last.
const BATCH: u64 = 32 << 20;
/// Largest file of a result, bytes: what stores take in one request.
const LARGEST: u64 = 5 << 30;

/// A file of a result as it stands in a store.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct UploadedFile {
    /// Path within the folder of the result.
    pub path: String,
    /// Its bytes.
    pub bytes: u64,
    /// Their digest.
    pub sha256: String,
}

/// Puts the files of a folder below a prefix. What stands there already, left by a run that was cut short or
/// by one that goes on beside this, is not replaced: the list says what stands there in the end.
///
/// # Errors
/// [`StoreError`].
pub fn upload(
    bucket: &dyn Bucket,
    folder: &Path,
    files: &[UploadedFile],
    prefix: &str,
) -> Result<Vec<UploadedFile>, StoreError> {
    let mut standing = Vec::new();
    let mut rest = files;
    while !rest.is_empty() {
        let mut bytes = 0;
        let count = rest.iter().take_while(|f| {
            bytes += f.bytes;
            bytes <= BATCH
        });
        let (batch, behind) = rest.split_at(count.count().max(1));
        rest = behind;
        let mut objects = Vec::new();
        for file in batch {
            let path = folder.join(&file.path);
            if file.bytes > LARGEST {
                return Err(StoreError::TooLarge {
                    uri: file.path.clone(),
                    bytes: file.bytes,
                    limit: LARGEST,
                });
            }
            let bytes = fs::read(&path).map_err(|source| StoreError::Scratch { path, source })?;
            objects.push((format!("{prefix}/{}", file.path), bytes));
        }
        for (file, created) in batch.iter().zip(bucket.create(objects)?) {
            standing.push(match created {
                Created::New => file.clone(),
                Created::Stood => as_it_stands(bucket, file, prefix)?,
            });
        }
    }
    Ok(standing)
}

fn as_it_stands(bucket: &dyn Bucket, file: &UploadedFile, prefix: &str) -> Result<UploadedFile, StoreError> {
    let path = format!("{prefix}/{}", file.path);
    // It was there a moment ago.
    let bytes = bucket.get(&path, LARGEST)?.ok_or(StoreError::Missing(path))?;
    let sha256 = hex(&Sha256::digest(&bytes));
    Ok(UploadedFile { path: file.path.clone(), bytes: bytes.len() as u64, sha256 })
}
