//! Errors of goals.

use std::path::PathBuf;

use super::collect_error::CollectError;
use io::UrdfError;

/// Most bags per goal.
pub(crate) const MAX_RUNS: usize = 1000;

/// Why a goal cannot be executed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum GoalError {
    /// The session has no recordings to read.
    #[error(transparent)]
    Session(#[from] CollectError),
    /// The settings file cannot be written.
    #[error("cannot write `{}`: {source}", path.display())]
    Settings {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The settings cannot be serialized.
    #[error(transparent)]
    Text(#[from] serde_norway::Error),
    /// Number of runs, if it is zero or too large.
    #[error("{0} runs; give 1 to {MAX_RUNS} bags")]
    Runs(usize),
    /// Gravity is not finite.
    #[error("gravity is not a number")]
    Gravity,
    /// No twin was reconstructed or given.
    #[error("no twin was made yet; name a URDF")]
    NoTwin,
    /// The twin cannot be read.
    #[error(transparent)]
    Twin(#[from] UrdfError),
}
