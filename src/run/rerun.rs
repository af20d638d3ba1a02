//! A rerun recording beside the run folder.

use std::path::Path;

use super::{Event, Monitor, RunError, Twin, outcome::OUTPUT_STAGE};
use capture::Capture;
use common::note::Note;

/// Writes views and findings to a file, if requested.
pub(super) fn write(
    path: Option<&Path>,
    capture: &Capture,
    twin: &Twin,
    warnings: &[Note],
    monitor: &Monitor,
) -> Result<(), RunError> {
    let Some(path) = path else { return Ok(()) };
    let seen = io::Seen { capture, surfaces: &twin.surfaces, model: &twin.model, warnings };
    io::write_rerun(path, &seen).map_err(|e| RunError::stage(OUTPUT_STAGE, e))?;
    monitor.report(Event::Artifact { path: path.display().to_string() });
    Ok(())
}
