//! Why a store is not read or written.

use std::path::PathBuf;

use super::uri::UriError;

/// Why a store is not read or written.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// No URI that is served.
    #[error(transparent)]
    Uri(#[from] UriError),
    /// A binary without stores.
    #[cfg(not(feature = "store"))]
    #[error(
        "`{0}`: this binary was built without object stores; build it with `cargo build --release \
         --features store`"
    )]
    Without(String),
    /// Nothing is there.
    #[error("`{0}` is not there: no object and no prefix of objects")]
    Missing(String),
    /// A folder of a web server.
    #[error("`{0}` is no object, and a web server lists no folders; name an object")]
    NoFolder(String),
    /// More objects than a recording has.
    #[error("`{uri}` holds more than {limit} objects: not a recording")]
    TooMany {
        /// The prefix.
        uri: String,
        /// Most that are taken.
        limit: usize,
    },
    /// An object that is larger than its kind may be.
    #[error("`{uri}` has {bytes} bytes, more than the limit of {limit}")]
    TooLarge {
        /// The object.
        uri: String,
        /// Its bytes.
        bytes: u64,
        /// Most that are taken.
        limit: u64,
    },
    /// The store cannot be reached, or refuses.
    #[error("`{uri}` cannot be reached")]
    Access {
        /// The place.
        uri: String,
        /// What the store said.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The scratch folder, or a result on its way.
    #[error("cannot use `{}`", path.display())]
    Scratch {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A disk with too little room.
    #[error("`{}` has {free} bytes free, and {needed} are needed; give another --scratch", path.display())]
    Full {
        /// The folder.
        path: PathBuf,
        /// Bytes that can be written.
        free: u64,
        /// Bytes that are to be written.
        needed: u64,
    },
}

impl StoreError {
    /// Whether the same command may succeed later: nothing is wrong with what was asked for.
    #[must_use]
    pub fn may_pass(&self) -> bool {
        matches!(self, Self::Access { .. } | Self::Scratch { .. } | Self::Full { .. })
    }

    /// Whether the command line is wrong.
    #[must_use]
    pub fn is_usage(&self) -> bool {
        match self {
            Self::Uri(_) => true,
            #[cfg(not(feature = "store"))]
            Self::Without(_) => true,
            _ => false,
        }
    }
}
