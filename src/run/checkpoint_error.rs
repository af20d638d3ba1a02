//! Why results of stages cannot be kept or used.

use std::{io, path::PathBuf};

/// Largest value of one stage, bytes: 16 states of 80 color and depth images of 1280 x 720 pixels each.
pub(super) const MAX_BYTES: u64 = 16 << 30;

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
