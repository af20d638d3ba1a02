//! Facts about a run for the report: inputs, settings, times, notes.

use std::collections::BTreeMap;

use super::{
    Fingerprint, ReconstructRequest, Stages, Twin, pictures::photo_path, reconstruct_twin::cautions,
};
use capture::Capture;
use common::note::{Note, NoteCode};
use config::{Config, Engine, Init, preset_cost};
use export::{
    CameraPosesReport, CameraTrackingReport, DepthSensorReport, InputFacts, PhotoAndTwin, Rendering,
    ReportPictures, RunFacts, StageTime, StateDifference, WorldFrameReport, compare_starts, nearest_starts,
};
use field::InstructionSet;

/// A rendered view with its similarity to the photo; `None` if that was not measured.
fn rendering(p: &PhotoAndTwin) -> Option<Rendering> {
    Some(Rendering {
        state: p.state,
        view: p.view.clone(),
        psnr_db: p.psnr_db?,
        photo: photo_path(p),
        camera: p.cutout.as_ref().map(|(_, camera)| camera.clone()),
    })
}

/// Facts about the run for the report.
pub(super) fn facts(
    request: &ReconstructRequest,
    fingerprint: &Fingerprint,
    capture: &Capture,
    twin: &Twin,
    images: &ReportPictures,
    stages: &Stages,
) -> RunFacts {
    let initialization = match request.config.run.init {
        Init::Registration => compare_starts(&twin.model, "registration", true, &twin.starts),
        Init::Identity => {
            // The result of registration alone, to compare both ways.
            let alone = nearest_starts(&twin.model, &twin.registered);
            let identity = compare_starts(&twin.model, "identity", true, &twin.starts);
            [identity, compare_starts(&twin.model, "registration", false, &alone)].concat()
        }
    };
    RunFacts {
        input: InputFacts {
            paths: request.sources.iter().map(|p| p.display().to_string()).collect(),
            frames: capture.states.iter().map(Vec::len).collect(),
        },
        initialization,
        differences: images.differences.clone(),
        renderings: images.states.iter().filter_map(rendering).collect(),
        part_count: Some(twin.part_count.clone()),
        object_box_m: capture.object_box_m,
        camera_tracking: CameraTrackingReport::of_findings(&capture.tracking),
        camera_poses: CameraPosesReport::of_corrections(&capture.poses.states),
        world_frame: twin.model.links.first().and_then(|root| {
            let middle = root.inertial.center_of_mass;
            capture
                .poses
                .frame_deviation(capture.states.first()?, &middle)
                .map(WorldFrameReport::of_uncertainty)
        }),
        depth_sensor: capture.poses.sensor.as_ref().map(DepthSensorReport::of_calibration),
        stages: stages
            .seconds
            .iter()
            .map(|(name, seconds)| StageTime { name: name.clone(), seconds: *seconds })
            .collect(),
        versions: BTreeMap::from([("artitwin".to_owned(), env!("CARGO_PKG_VERSION").to_owned())]),
        seed: request.config.run.seed,
        preset: preset(&request.config.run.preset),
        config_digest: config_digest(fingerprint),
        fingerprint: fingerprint.text(),
        device: device(&request.config, twin.replaced_engines.len(), capture.states.len()),
        notes: capture
            .notes
            .iter()
            .chain(&twin.notes)
            .cloned()
            .chain(twin.replaced_engines.iter().map(|why| Note::new(NoteCode::EngineReplaced, why)))
            .collect(),
        warnings: capture
            .warnings
            .iter()
            .cloned()
            .chain(twin.warnings.iter().cloned())
            // Warnings include the cautions, so readers of this list miss nothing.
            .chain(cautions(&twin.model))
            .chain(images.differences.iter().filter_map(StateDifference::difference_warning))
            .collect(),
    }
}

/// A preset and its cost.
fn preset(name: &str) -> String {
    preset_cost(name).map_or_else(|| name.to_owned(), |cost| format!("{name}: {cost}"))
}

/// A digest of all settings.
fn config_digest(fingerprint: &Fingerprint) -> String {
    fingerprint.only(|fact| fact.starts_with("config.")).text()
}

/// The device of the numeric work: the engine that trained the `fields`, `replaced` of which the CPU engine
/// finished, or the CPU if no field was trained.
fn device(config: &Config, replaced: usize, fields: usize) -> String {
    let threads = rayon::current_num_threads();
    let cpu = format!("cpu engine ({})", InstructionSet::detect().name());
    let engine = if config.trains_fields() { config.run.engine } else { Engine::Cpu };
    let asked = match engine {
        Engine::Cpu => return format!("{cpu}, {threads} threads"),
        Engine::Burn => "burn on the CPU",
        Engine::Gpu => "burn on the GPU",
    };
    let by_cpu = if replaced > 0 {
        format!(", {replaced} of {fields} fields finished by the {cpu}")
    } else {
        String::new()
    };
    format!("{asked}, {threads} threads{by_cpu}")
}
