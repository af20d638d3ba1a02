//! How a run begins and ends: with an earlier result, or the checkpoint of a stopped run.

use std::path::{Path, PathBuf};

use super::{
    Cancelled, Checkpoint, Event, Fingerprint, Monitor, Outcome, ReconstructRequest, RunError, chain,
};
use common::note::{Note, NoteCode};

/// How a run begins.
pub(super) enum Beginning {
    /// There is a finished result already.
    Stands(Outcome),
    /// There is a store for the results of its stages, empty or left by a stopped run.
    Open(Checkpoint),
}

/// Begins the run of a request, or continues a stopped one.
///
/// # Errors
/// If the checkpoint cannot be used, or there is only the result of another run to continue.
pub(super) fn begin(
    request: &ReconstructRequest,
    name: &str,
    fingerprint: &Fingerprint,
    monitor: &Monitor,
) -> Result<Beginning, RunError> {
    let folder = Checkpoint::folder(&request.out, name);
    let result = request.out.join(name);
    // A result to be moved away by force may have been changed.
    let continues = request.resume && !request.force;
    let earlier = if continues { io::read_result_fingerprint(&result) } else { None };
    // The result is checked first: if it exists, an old checkpoint does not matter.
    if earlier.as_ref() == Some(&fingerprint.text()) {
        return Ok(Beginning::Stands(stands(result, &folder, fingerprint, monitor)));
    }
    let checkpoint = Checkpoint::open(&folder, fingerprint, request.resume)?;
    if request.resume && !checkpoint.is_continued() {
        if earlier.is_some() {
            checkpoint.discard()?;
            return Err(RunError::OtherResult { folder: result });
        }
        let text = format!(
            "there is no usable checkpoint of {name} in {}; the run starts anew",
            request.out.display()
        );
        monitor.note(&Note::new(NoteCode::StartsAnew, text));
    }
    Ok(Beginning::Open(checkpoint))
}

/// Deletes the checkpoint of a finished run, and reports its result.
pub(super) fn finished(outcome: Outcome, checkpoint: Checkpoint, monitor: &Monitor) -> Outcome {
    if let Err(error) = checkpoint.remove() {
        let text =
            format!("the result is whole, but what was kept on the way is not deleted: {}", chain(&error));
        monitor.warn(&Note::new(NoteCode::CheckpointLeft, text));
    }
    monitor.report(Event::Artifact { path: outcome.folder.display().to_string() });
    outcome
}

/// Reports that a run is finished already. Its checkpoint is deleted, in case the process ended between the
/// two.
fn stands(folder: PathBuf, checkpoint: &Path, fingerprint: &Fingerprint, monitor: &Monitor) -> Outcome {
    // The process may have ended after the result was committed and before the checkpoint was deleted.
    if checkpoint.exists()
        && let Ok(left) = Checkpoint::open(checkpoint, fingerprint, true)
    {
        left.remove().unwrap_or_else(|error| {
            monitor.warn(&Note::new(NoteCode::CheckpointLeft, chain(&error)));
        });
    }
    let path = folder.display().to_string();
    let text =
        format!("{path} is finished: the same inputs, settings and version made it; nothing is left to do");
    monitor.note(&Note::new(NoteCode::ResultStands, text));
    monitor.report(Event::Artifact { path });
    Outcome { folder, joints: Vec::new(), warnings: Vec::new(), degraded: false, stood: true }
}

/// Deletes the finished stages of a failed run unless a later run can use them; then reports where they are.
pub(super) fn ended(error: RunError, checkpoint: Checkpoint, keep: bool, monitor: &Monitor) -> RunError {
    let bytes = checkpoint.bytes().unwrap_or_default();
    // After most failures the same input fails again, and a checkpoint would only fill the disk.
    if !keep || !error.can_continue() || bytes == 0 {
        return checkpoint.discard().err().map_or(error, RunError::from);
    }
    let megabytes = bytes.div_ceil(1_000_000);
    let folder = checkpoint.store.path().display();
    let kept = format!(
        "what it finished is kept in {folder} ({megabytes} MB): give the same command to continue \
         with --resume"
    );
    match error {
        RunError::Cancelled(_) => Cancelled { kept }.into(),
        other => {
            monitor.note(&Note::new(NoteCode::KeptForResume, kept));
            other
        }
    }
}
