//! Checks before any work, and the fingerprint of a run.

use super::{
    Checkpoint, Fingerprint, ReconstructRequest, RunError, least_bytes::least_reconstruction,
    outcome::OUTPUT_STAGE,
};
use config::{Config, Init, Method};
use io::{self, ResultKind};

/// Refuses requests that no recording could fulfil; returns the name of the twin.
pub(super) fn checked_name(request: &ReconstructRequest) -> Result<String, RunError> {
    request.config.check().map_err(|e| e.with_origin(&request.origins))?;
    // Judged by names and folders only; nothing is decoded yet.
    let found = io::object_name(&request.sources).map_err(|e| RunError::stage("capture", e))?;
    let states = io::state_count(&request.sources).map_err(|e| RunError::stage("capture", e))?;
    if states > 2 && request.config.takes_two_states() {
        let message = format!(
            "{states} states were given, but fields are made consistent, and joints inferred as published, \
             between two; give two states, or leave out `run.init=identity`, the presets fields, paper and \
             paris, `articulation.refine` and `joint.inference`"
        );
        return Err(RunError::stage("articulate", message));
    }
    let run = &request.config.run;
    let many = request.config.radiance.many_parts;
    if run.method == Method::Radiance && many && run.init == Init::Identity && run.parts.is_none() {
        let message = "the method does not find the number of parts; give it with --parts N";
        return Err(RunError::stage("radiance/free", message));
    }
    if let Some(path) = request.rerun.as_ref().filter(|path| path.symlink_metadata().is_ok()) {
        let message = format!("`{}` is there; give --rerun a name that is not taken", path.display());
        return Err(RunError::stage(OUTPUT_STAGE, message));
    }
    let name = request.name.clone().unwrap_or(found);
    check_places(request, &name, states).map_err(|e| RunError::stage(OUTPUT_STAGE, e))?;
    Ok(name)
}

/// Refuses places that cannot be written: the result's, under either of its names, and the checkpoint's.
fn check_places(request: &ReconstructRequest, name: &str, states: usize) -> Result<(), io::RunDirError> {
    let least_bytes = least_reconstruction(states, &request.config);
    for place in [request.place(name), request.rejected_place(name)] {
        place.check(ResultKind::Reconstruct, least_bytes)?;
    }
    request.place(name).check_beside(&Checkpoint::folder(&request.out, name))
}

/// The user's matching model, if there is one.
pub(super) fn matcher(config: &Config) -> Result<Option<io::OnnxMatcher>, RunError> {
    let Some(path) = &config.matching.onnx else { return Ok(None) };
    let matcher = io::OnnxMatcher::open(path, config.matching.onnx_max_side_px);
    matcher.map(Some).map_err(|e| RunError::stage("match", e))
}

/// Fingerprint of a run, for its checkpoint.
pub(super) fn fingerprint(request: &ReconstructRequest) -> Result<Fingerprint, RunError> {
    let failed = |e| RunError::stage("checkpoint", e);
    let mut all = Fingerprint::default()
        .with("version", env!("CARGO_PKG_VERSION"))
        .with_settings("config", &request.config)
        .map_err(failed)?;
    if let Some(path) = &request.config.matching.onnx {
        all = all.with_source("matcher", path).map_err(failed)?;
    }
    for (i, source) in request.sources.iter().enumerate() {
        all = all.with_source(&format!("source{i}"), source).map_err(failed)?;
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::{super::chain, *};

    #[test]
    fn a_recording_of_rerun_takes_no_place_of_another_file() {
        let folder = tempfile::tempdir().unwrap();
        let taken = folder.path().join("mine.rrd");
        std::fs::write(&taken, "mine").unwrap();
        let bag = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../bags/drawer");
        let mut request = ReconstructRequest::new([bag], folder.path().join("runs"));
        request.rerun = Some(folder.path().join("new.rrd"));
        assert_eq!(checked_name(&request).unwrap(), "drawer");
        request.rerun = Some(taken);
        let refused = chain(&checked_name(&request).unwrap_err());
        assert!(refused.contains("mine.rrd` is there"), "{refused}");
    }
}
