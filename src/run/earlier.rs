//! What an earlier run left: a finished result, or what a stopped one keeps.

use std::path::{Path, PathBuf};

use super::{Cancelled, Checkpoint, Event, Fingerprint, Monitor, Outcome, RunError, chain};
use crate::io;

/// The result that has the name of a run, for `--resume`.
pub(super) enum Earlier {
    /// There is none.
    Nothing,
    /// Of inputs, settings and a version that compute the same.
    Same(PathBuf),
    /// Of others.
    Other(PathBuf),
}

impl Earlier {
    /// What stands in a run folder. That it was not changed since is for the caller to know.
    pub fn of(folder: &Path, fingerprint: &Fingerprint) -> Self {
        match io::read_result_fingerprint(folder) {
            None => Self::Nothing,
            Some(found) if found == fingerprint.text() => Self::Same(folder.to_owned()),
            Some(_) => Self::Other(folder.to_owned()),
        }
    }
}

/// Tells that a run is finished. What it kept on the way is deleted, in case it ended between the two.
pub(super) fn stands(folder: PathBuf, checkpoint: &Path, fingerprint: &Fingerprint, monitor: &Monitor) -> Outcome {
    if checkpoint.exists()
        && let Ok(left) = Checkpoint::open(checkpoint, fingerprint, true)
    {
        left.remove().unwrap_or_else(|error| monitor.warn(chain(&error)));
    }
    let path = folder.display().to_string();
    let message = format!("{path} is finished: the same inputs, settings and version made it; nothing is left to do");
    monitor.tell(Event::Note { message });
    monitor.tell(Event::Artifact { path });
    Outcome { folder, joints: Vec::new(), warnings: Vec::new(), degraded: false, stood: true }
}

/// Deletes what a run has finished if that is of no use to a later one, else says where it is kept.
pub(super) fn ended(error: RunError, checkpoint: Checkpoint, keep: bool, monitor: &Monitor) -> RunError {
    let bytes = checkpoint.bytes().unwrap_or_default();
    if !keep || !error.can_continue() || bytes == 0 {
        return checkpoint.discard().err().map_or(error, RunError::from);
    }
    let (megabytes, folder) = (bytes.div_ceil(1_000_000), checkpoint.path().display());
    let kept = format!("what it finished is kept in {folder} ({megabytes} MB): give the same command to continue with --resume");
    match error {
        RunError::Cancelled(_) => Cancelled { kept }.into(),
        other => {
            monitor.tell(Event::Note { message: kept });
            other
        }
    }
}
