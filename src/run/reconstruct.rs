//! The pipeline, from recordings to a run folder.

use super::{
    Checkpoint, Fingerprint, JointSummary, Monitor, Outcome, ReconstructRequest, RunError, Stages,
    admission::{checked_name, fingerprint, matcher},
    capture,
    earlier::{Beginning, begin, ended, finished},
    facts::facts,
    outcome::CHECK_STAGE,
    pictures::pictures,
    plan::foreseen,
    reconstruct_twin,
    stage_store::StageStore,
    write::write,
};
use export::{Report, StateDifference, check_folder, link_looks, package};

/// Reconstructs the object of a request: writes `out/<name>/` and returns the outcome.
///
/// # Errors
/// If the request cannot be fulfilled (reported before any work), a stage fails or the monitor requests a
/// stop; nothing exists under the final name then.
pub fn reconstruct(request: &ReconstructRequest, monitor: &Monitor) -> Result<Outcome, RunError> {
    // Requests that cannot succeed are refused before anything is decoded.
    let name = checked_name(request)?;
    let matcher = matcher(&request.config)?;
    let fingerprint = fingerprint(request)?;
    // Opened even if nothing is to be kept: its lock keeps out a second run of this name.
    let checkpoint = match begin(request, &name, &fingerprint, monitor)? {
        Beginning::Stands(outcome) => return Ok(outcome),
        Beginning::Open(checkpoint) => checkpoint,
    };
    match reconstruct_files(&name, matcher.as_ref(), request, &fingerprint, &checkpoint, monitor) {
        Ok(outcome) => Ok(finished(outcome, checkpoint, monitor)),
        Err(error) => Err(ended(error, checkpoint, request.keep, monitor)),
    }
}

/// The store of stage results for runs with other settings, if requested.
fn stage_folder(
    name: &str,
    request: &ReconstructRequest,
    fingerprint: &Fingerprint,
) -> Result<Option<StageStore>, RunError> {
    let Some(folder) = &request.stages else { return Ok(None) };
    // Results also depend on facts outside the recordings: the twin's name, and paths in notes.
    let mut facts = fingerprint.clone().with("name", name);
    for (i, source) in request.sources.iter().enumerate() {
        facts = facts.with(format!("place{i}"), source.display());
    }
    Ok(Some(StageStore::open(folder, facts)?))
}

/// Runs all stages and puts the run folder in its place.
fn reconstruct_files(
    name: &str,
    matcher: Option<&io::OnnxMatcher>,
    request: &ReconstructRequest,
    fingerprint: &Fingerprint,
    checkpoint: &Checkpoint,
    monitor: &Monitor,
) -> Result<Outcome, RunError> {
    let config = &request.config;
    let folder = stage_folder(name, request, fingerprint)?;
    let mut stages = Stages::keeping(monitor, request.keep.then_some(&checkpoint.store), folder.as_ref());
    monitor.report(foreseen(request));
    // Recordings to posed, masked, denoised frames.
    let mut capture = stages.kept("capture", None, |monitor| {
        let seed = config.run.seed;
        capture::open(&request.sources, &config.capture, seed, &request.ahead, monitor)
            .map_err(|e| RunError::reading("capture", e))
    })?;
    // Outside the stage, which a continued run does not compute again.
    capture.notes.iter().for_each(|n| monitor.note(n));
    capture.warnings.iter().for_each(|w| monitor.warn(w));
    // Frames to a model.
    let twin = reconstruct_twin(name, &mut capture, matcher, config, &mut stages)?;
    let (looks, images) = stages.run("pictures", None, |_| {
        let looks = link_looks(&twin.model, &capture, &config.look);
        let images = pictures(&capture, &twin.model, &looks);
        Ok::<_, RunError>((looks, images))
    })?;
    images.differences.iter().filter_map(StateDifference::difference_warning).for_each(|w| monitor.warn(&w));
    // The model to files in memory.
    let files =
        stages.kept("export", None, |_| Ok::<_, RunError>(package(&twin.model, &looks, &config.export)))?;
    // The files as a simulator would read them.
    let found = stages.run(CHECK_STAGE, None, |_| {
        Ok::<_, RunError>(check_folder(&files.iter().map(|f| (f.path.clone(), f.bytes.clone())).collect()))
    })?;
    let facts = facts(request, fingerprint, &capture, &twin, &images, &stages);
    let report = Report::new(&twin.model, &files, facts);
    // All at once, under the final name.
    let folder = write(&twin.model, &files, &found, &report, &images, request, monitor)?;
    let warnings = report.run.warnings;
    #[cfg(feature = "rerun")]
    super::rerun::write(request.rerun.as_deref(), &capture, &twin, &warnings, monitor)?;
    Ok(Outcome {
        folder,
        joints: JointSummary::of(&twin.model),
        degraded: !warnings.is_empty(),
        warnings,
        stood: false,
    })
}
