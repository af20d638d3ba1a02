//! Why a result folder could not be written.

use std::{
    io,
    path::{Path, PathBuf},
};

/// Why a result folder could not be written.
#[derive(Debug, thiserror::Error)]
pub enum RunDirError {
    /// The name cannot be a folder's name.
    #[error("'{0}' cannot name an output folder: use letters, digits and _, beginning with a letter")]
    Name(String),
    /// The path does not end in a name.
    #[error("'{}' cannot be the result's folder: give a path that ends in a name, or add \
        --name", .0.display())]
    NoName(PathBuf),
    /// A path leads out of the folder or cannot be a file name.
    #[error("'{0}' is no path inside the output folder")]
    Path(String),
    /// The place contains files that the command did not write, or that changed since.
    #[error("{} is left as it is: {why}; give another --out or --name, or --force, which moves it to \
        {}", path.display(), backup(path, 0).display())]
    Taken {
        /// Where the result should go.
        path: PathBuf,
        /// What is there.
        why: String,
    },
    /// The result would take the place of an input.
    #[error("the result cannot go to {}, which is or holds the input {}; give another --out or \
        --name", folder.display(), input.display())]
    HoldsInput {
        /// Where the result should go.
        folder: PathBuf,
        /// An input, as it was given.
        input: PathBuf,
    },
    /// Nothing can be written there.
    #[error("cannot write into {}; choose another --out or make it writable", folder.display())]
    Unwritable {
        /// The folder, or the nearest existing one above it.
        folder: PathBuf,
        /// Error of the system.
        source: io::Error,
    },
    /// The disk is too full.
    #[error("the disk of {} has {free} bytes free, and {least_bytes} at least are needed; make room or \
        give another --out", folder.display())]
    Full {
        /// The folder, or the nearest existing one above it.
        folder: PathBuf,
        /// Least size of the result, bytes.
        least_bytes: u64,
        /// Free space, bytes.
        free: u64,
    },
    /// The disk refused.
    #[error("cannot {what} {path}: {source}")]
    Disk {
        /// The failed operation.
        what: &'static str,
        /// Its path.
        path: PathBuf,
        /// Error of the system.
        source: io::Error,
    },
}

/// `NAME.bak`, `NAME.bak1`, ...
pub(super) fn backup(target: &Path, k: usize) -> PathBuf {
    let mut name = target.file_name().unwrap_or_default().to_owned();
    name.push(if k == 0 { ".bak".to_owned() } else { format!(".bak{k}") });
    target.with_file_name(name)
}
