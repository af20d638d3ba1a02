//! What became of a job, as it stands beside its result.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{note::Note, store::UploadedFile};

/// Name of the format.
pub const FORMAT: &str = "artitwin-job/1";
/// Largest manifest that is read, bytes.
pub const MAX_MANIFEST: u64 = 64 << 20;

/// How a job ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// With a result.
    Done,
    /// With a result that is uncertain, or for which data was lost.
    Degraded,
    /// Without one, and the same inputs and settings give none.
    Refused,
}

/// What went over the network.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Transfer {
    /// Bytes of all inputs.
    pub bytes_stored: u64,
    /// Bytes that were read of them.
    pub bytes_read: u64,
    /// Bytes that were written to a store.
    pub bytes_written: u64,
    /// Requests.
    pub requests: u64,
    /// Requests that were sent again.
    pub retries: u64,
    /// Time spent waiting for stores, seconds.
    pub seconds: f64,
}

/// An input as the job found it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct InputFound {
    /// What was given.
    pub uri: String,
    /// What the key holds of it.
    pub identity: String,
    /// Its bytes.
    pub bytes_stored: u64,
    /// Bytes that were read of it.
    pub bytes_read: u64,
}

/// What became of a job.
#[derive(Clone, Debug, Serialize)]
pub struct Manifest {
    /// [`FORMAT`].
    pub format: &'static str,
    /// Key of the job.
    pub key: String,
    /// `reconstruct` or `diagnose`.
    pub command: String,
    /// Name of the result.
    pub name: String,
    /// How it ended.
    pub status: Status,
    /// Exit code of the command.
    pub exit_code: u8,
    /// Why it was refused.
    pub message: Option<String>,
    /// `KEY/NAME`.
    pub folder: Option<String>,
    /// Files of that folder.
    pub files: Vec<UploadedFile>,
    /// What was lost or is uncertain.
    pub warnings: Vec<Note>,
    /// Version of the program.
    pub version: &'static str,
    /// What was read.
    pub inputs: Vec<InputFound>,
    /// What went over the network.
    pub transfer: Transfer,
    /// Wall time, seconds.
    pub seconds: f64,
    /// Processor time, seconds.
    pub cpu_seconds: f64,
    /// Most resident memory, bytes.
    pub peak_memory_bytes: u64,
    /// When it began, RFC 3339.
    pub started: String,
    /// What was estimated before.
    pub estimate: Value,
}

/// What a later command needs of a manifest that stands.
#[derive(Clone, Debug, Deserialize)]
pub struct Standing {
    /// Must be [`FORMAT`].
    pub format: String,
    /// How it ended.
    pub status: Status,
    /// Exit code of the command.
    pub exit_code: u8,
    /// Why it was refused.
    #[serde(default)]
    pub message: Option<String>,
}
