//! Why a run could not be measured.

use std::path::PathBuf;

use io::{MeshFileError, NpyError, UrdfError};

/// Most samples per surface.
pub const MAX_SAMPLES: usize = 1_000_000;

/// Why a run could not be measured.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// No run was given.
    #[error("there is no run to evaluate: name at least one output folder")]
    NoRun,
    /// The number of samples is out of range.
    #[error("{0} samples per surface cannot be drawn: choose 1 to {MAX_SAMPLES}")]
    Samples(usize),
    /// A file or folder could not be read.
    #[error("cannot read {path}: {source}")]
    Disk {
        /// The file or folder.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The folder does not hold a run.
    #[error(
        "{path} holds {count} .urdf files, one is needed: name the folder with <name>.urdf and report.json \
         in it"
    )]
    NotARun {
        /// The folder.
        path: PathBuf,
        /// Number of `.urdf` files in it.
        count: usize,
    },
    /// A JSON file does not have the expected form.
    #[error("{path}: {source}")]
    Json {
        /// The file.
        path: PathBuf,
        /// The parser's error.
        source: serde_json::Error,
    },
    /// A file of the truth or the run has invalid content.
    #[error("{path}: {problem}")]
    Invalid {
        /// The file.
        path: PathBuf,
        /// The problem.
        problem: String,
    },
    /// There are too many parts to match.
    #[error("{count} movable parts; {limit} are the limit")]
    TooManyParts {
        /// Number of parts on the larger side.
        count: usize,
        /// Largest number of parts that can be matched.
        limit: usize,
    },
    /// The URDF of the run could not be read.
    #[error(transparent)]
    Urdf(#[from] UrdfError),
    /// A mesh of the truth could not be read.
    #[error(transparent)]
    Mesh(#[from] MeshFileError),
    /// The seen points could not be read.
    #[error(transparent)]
    Npy(#[from] NpyError),
}
