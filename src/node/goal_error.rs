//! Why a goal cannot be worked on.

use std::path::PathBuf;

use super::collect_error::CollectError;
use io::UrdfError;

/// Most bags of one goal.
pub(crate) const MAX_RUNS: usize = 1000;

/// Why a goal cannot be worked on.
#[derive(Debug, thiserror::Error)]
pub(crate) enum GoalError {
    /// The session has no recordings to read.
    #[error(transparent)]
    Session(#[from] CollectError),
    /// The settings cannot be kept beside the recordings.
    #[error("cannot write `{}`: {source}", path.display())]
    Settings {
        /// The file.
        path: PathBuf,
        /// The system's message.
        source: std::io::Error,
    },
    /// The settings have no text.
    #[error(transparent)]
    Text(#[from] serde_norway::Error),
    /// No runs, or too many.
    #[error("{0} runs; give 1 to {MAX_RUNS} bags")]
    Runs(usize),
    /// No vector.
    #[error("gravity is not a number")]
    Gravity,
    /// None was made or named.
    #[error("no twin was made yet; name a URDF")]
    NoTwin,
    /// It cannot be read.
    #[error(transparent)]
    Twin(#[from] UrdfError),
}
