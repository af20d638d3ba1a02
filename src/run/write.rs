//! The last step: puts the run folder in its place.

use std::path::PathBuf;

use super::{
    Monitor, ReconstructRequest, RunError,
    outcome::{CHECK_STAGE, OUTPUT_STAGE},
    pictures::photo_path,
};
use export::{CheckFinding, ExportFile, Level, Report, ReportPictures, report_html};
use io::{self, ResultKind};
use model::ArticulatedModel;

/// Puts the complete run folder in its place; if the check found an error, under a name that says so.
pub(super) fn write(
    model: &ArticulatedModel,
    files: &[ExportFile],
    found: &[CheckFinding],
    report: &Report,
    images: &ReportPictures,
    request: &ReconstructRequest,
    monitor: &Monitor,
) -> Result<PathBuf, RunError> {
    let failed = |e: Box<dyn std::error::Error + Send + Sync>| RunError::stage(OUTPUT_STAGE, e);
    let errors: Vec<String> =
        found.iter().filter(|f| f.level == Level::Error).map(ToString::to_string).collect();
    // A twin that fails the check must not appear under the requested name.
    let place =
        if errors.is_empty() { request.place(&model.name) } else { request.rejected_place(&model.name) };
    let dir = io::RunDir::open(&place, ResultKind::Reconstruct).map_err(|e| failed(e.into()))?;
    for file in files {
        dir.put(&file.path, &file.bytes).map_err(|e| failed(e.into()))?;
    }
    for pair in &images.states {
        if let Some((png, _)) = &pair.cutout {
            dir.put(&photo_path(pair), png).map_err(|e| failed(e.into()))?;
        }
    }
    let html = report_html(report, images).map_err(|e| failed(e.into()))?;
    dir.put("report.json", report.to_json().as_bytes()).map_err(|e| failed(e.into()))?;
    dir.put("report.html", html.as_bytes()).map_err(|e| failed(e.into()))?;
    let committed = dir.commit().map_err(|e| failed(e.into()))?;
    committed.note().iter().for_each(|n| monitor.note(n));
    let folder = committed.folder;
    if errors.is_empty() {
        return Ok(folder);
    }
    let message = format!(
        "a simulator would not load the model as it is meant; its files are in {}: {}",
        folder.display(),
        errors.join("; ")
    );
    Err(RunError::stage(CHECK_STAGE, message))
}
