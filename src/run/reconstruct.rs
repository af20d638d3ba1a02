//! The pipeline, in the order of the method: frames, matches, fields, surfaces, parts and motions, joints, model, files.

use std::{collections::BTreeMap, path::PathBuf};

use nalgebra::Matrix6;

use super::{
    Checkpoint, Event, Fingerprint, JointSummary, Monitor, Outcome, ReconstructRequest, RunError, Stages,
    alignment::{Aligned, align, moved_back},
    articulation::Search,
    chain,
    earlier::{Earlier, ended, stands},
    fields::train_field,
    found::{Found, found_in_all, found_in_pair, more_views, stage_of},
    least_bytes::least_reconstruction,
    matching::{pairs, pixel_matches},
    outcome::OUTPUT_STAGE,
    pictures::pictures,
    state_surface::{Band, StateSurface, fuse, state_surface},
    twin::{Seen, assemble, joints},
};
use crate::{
    articulate::{LiftedMatch, lift},
    capture::{Capture, CaptureConfig, PoseFindings, RgbdFrame, scene_box},
    config::{Config, Engine, Init, preset_cost},
    export::{
        CameraPosesReport, CheckFinding, ExportFile, InputFacts, Level, PartCountReport, PhotoAndTwin, Rendering, Report, ReportPictures,
        RunFacts, StageTime, check_folder, compare_starts, looks, nearest_starts, package, report_html,
    },
    field::{InstructionSet, ObjectField, Occupancy, TrainInput},
    geometry::{Pose, SceneBox},
    io::{self, ResultKind},
    model::{ArticulatedModel, validate},
    surface::SurfaceSource,
};

/// A model and what the report tells of how it came about.
pub struct Twin {
    /// The model.
    pub model: ArticulatedModel,
    /// Motion to the last state that each moving part's refinement started from, in the order of the joints.
    pub starts: Vec<Pose>,
    /// The motions that registration found, in its own order.
    pub registered: Vec<Pose>,
    /// How the number of parts was found.
    pub part_count: PartCountReport,
    /// For every state behind state 0 what takes what stands still from state 0's world frame to its own, where they
    /// differed: the model stands in state 0's.
    pub drifts: Vec<Option<Pose>>,
    /// Sentences about what was chosen.
    pub notes: Vec<String>,
    /// Sentences about evidence that is weak.
    pub warnings: Vec<String>,
    /// Why the CPU engine took over from the one that was asked for, by state.
    pub replaced_engines: Vec<String>,
}

/// Reconstructs the object of a request: writes `out/<name>/` and gives back what was found.
///
/// # Errors
/// If the request cannot be fulfilled, which is told before any work, a stage fails or the monitor asks to stop; nothing
/// stands under the final name then.
pub fn reconstruct(request: &ReconstructRequest, monitor: &Monitor) -> Result<Outcome, RunError> {
    let name = checked_name(request)?;
    let matcher = matcher(&request.config)?;
    let fingerprint = fingerprint(request)?;
    // What is moved away by force need not be as it was written.
    let earlier = if request.resume && !request.force { Earlier::of(&request.out.join(&name), &fingerprint) } else { Earlier::Nothing };
    if let Earlier::Same(folder) = earlier {
        return Ok(stands(folder, &Checkpoint::folder(&request.out, &name), &fingerprint, monitor));
    }
    let checkpoint = Checkpoint::open(&Checkpoint::folder(&request.out, &name), &fingerprint, request.resume)?;
    if request.resume && !checkpoint.is_continued() {
        if let Earlier::Other(folder) = earlier {
            checkpoint.discard()?;
            return Err(RunError::OtherResult { folder });
        }
        let message = format!("there is no usable checkpoint of {name} in {}; the run starts anew", request.out.display());
        monitor.tell(Event::Note { message });
    }
    match reconstruct_files(&name, matcher.as_ref(), request, (&fingerprint, &checkpoint), monitor) {
        Ok(outcome) => {
            if let Err(error) = checkpoint.remove() {
                monitor.warn(format!("the result is whole, but what was kept on the way is not deleted: {}", chain(&error)));
            }
            monitor.tell(Event::Artifact { path: outcome.folder.display().to_string() });
            Ok(outcome)
        }
        Err(error) => Err(ended(error, checkpoint, request.keep, monitor)),
    }
}

/// Refuses what no recording could make right; the name of the twin.
fn checked_name(request: &ReconstructRequest) -> Result<String, RunError> {
    request.config.check().map_err(|e| e.with_origin(&request.origins))?;
    let found = io::object_name(&request.sources).map_err(|e| RunError::stage("capture", e))?;
    let states = io::state_count(&request.sources).map_err(|e| RunError::stage("capture", e))?;
    if states > 2 && request.config.seeks_consistency() {
        let message = format!(
            "{states} states were given, but fields are made consistent between two; give two states, or leave out `--init identity`, \
             the presets fields and paper, and `articulation.refine`"
        );
        return Err(RunError::stage("articulate", message));
    }
    let name = request.name.clone().unwrap_or(found);
    check_places(request, &name, states).map_err(|e| RunError::stage(OUTPUT_STAGE, e))?;
    Ok(name)
}

/// Refuses what could not be written at the end: the result, under either of its names, and the checkpoint.
fn check_places(request: &ReconstructRequest, name: &str, states: usize) -> Result<(), io::RunDirError> {
    let least_bytes = least_reconstruction(states, &request.config);
    for place in [request.place(name), request.rejected_place(name)] {
        place.check(ResultKind::Reconstruct, least_bytes)?;
    }
    request.place(name).check_beside(&Checkpoint::folder(&request.out, name))
}

/// The user's matching model, if there is one.
fn matcher(config: &Config) -> Result<Option<io::OnnxMatcher>, RunError> {
    let open = |path: &PathBuf| io::OnnxMatcher::open(path, config.matching.onnx_max_side_px);
    config.matching.onnx.as_ref().map(open).transpose().map_err(|e| RunError::stage("match", e))
}

/// All stages, and the run folder in its place.
fn reconstruct_files(
    name: &str,
    matcher: Option<&io::OnnxMatcher>,
    request: &ReconstructRequest,
    (fingerprint, checkpoint): (&Fingerprint, &Checkpoint),
    monitor: &Monitor,
) -> Result<Outcome, RunError> {
    let config = &request.config;
    let mut stages = Stages::new(monitor);
    let keep = request.keep.then_some(checkpoint);
    let mut capture = stages.kept(keep, "capture", None, |_| {
        io::open(&request.sources, &config.capture, config.run.seed).map_err(|e| RunError::stage("capture", e))
    })?;
    capture.notes.iter().for_each(|n| monitor.tell(Event::Note { message: n.clone() }));
    capture.warnings.iter().for_each(|w| monitor.warn(w));
    let twin = reconstruct_twin(name, &capture, matcher, config, keep, &mut stages)?;
    for (frames, drift) in capture.states.iter_mut().skip(1).zip(&twin.drifts) {
        if let Some(drift) = drift {
            *frames = moved_back(frames, drift);
        }
    }
    let images = stages.run("pictures", None, |_| Ok::<_, RunError>(pictures(&capture, &twin.model)))?;
    let files = stages.kept(keep, "export", None, |_| {
        Ok::<_, RunError>(package(&twin.model, &looks(&twin.model, &capture, &config.look), &config.export))
    })?;
    let found = stages
        .run("check", None, |_| Ok::<_, RunError>(check_folder(&files.iter().map(|f| (f.path.clone(), f.bytes.clone())).collect())))?;
    let report = Report::new(&twin.model, facts(request, fingerprint, &capture, &twin, &images, &stages));
    let folder = write(&twin.model, &files, &found, &report, &images, request, monitor)?;
    let warnings = report.run.warnings;
    Ok(Outcome { folder, joints: JointSummary::of(&twin.model), degraded: !warnings.is_empty(), warnings, stood: false })
}

/// From frames to a model; touches no disk but the checkpoint's.
///
/// # Errors
/// If a stage fails or is asked to stop.
pub fn reconstruct_twin(
    name: &str,
    capture: &Capture,
    matcher: Option<&io::OnnxMatcher>,
    config: &Config,
    checkpoint: Option<&Checkpoint>,
    stages: &mut Stages,
) -> Result<Twin, RunError> {
    let recorded = capture.frames();
    let count = recorded.len();
    // The noise model scaled to what the recording shows.
    let config = &Config { capture: CaptureConfig { noise: capture.noise, ..config.capture.clone() }, ..config.clone() };
    let noise = &config.capture.noise;
    let no_depth = || RunError::stage("scene", "no depth reading of the object can be used; check masks, depth and workspace");
    let scene = scene_box(&recorded, noise).ok_or_else(no_depth)?;
    let pairs =
        (1..count).map(|state| match_pair(state, capture, matcher, &scene, config, checkpoint, stages)).collect::<Result<Vec<_>, _>>()?;
    let (matches, aligned): (Vec<Vec<LiftedMatch>>, Vec<Option<Aligned>>) = pairs.into_iter().unzip();
    let drifts: Vec<Option<Pose>> = aligned.iter().map(|a| a.as_ref().map(|a| a.world_from_world0)).collect();
    let moved: Vec<Option<Vec<RgbdFrame>>> =
        drifts.iter().zip(&recorded[1..]).map(|(drift, frames)| drift.as_ref().map(|drift| moved_back(frames, drift))).collect();
    let own = moved.iter().zip(&recorded[1..]).map(|(moved, frames)| moved.as_deref().unwrap_or(frames));
    let frames: Vec<&[RgbdFrame]> = recorded[..1].iter().copied().chain(own).collect();
    let scene = scene_box(&frames, noise).unwrap_or(scene);
    let band = Band::of(&frames, &scene, noise, &config.surface);
    let Observed { surfaces, fields, replaced_engines } = observe(&frames, scene, &band, config, checkpoint, stages)?;
    let search = |state: usize| Search {
        frames: [frames[0], frames[state]],
        surfaces: [&surfaces[0], &surfaces[state]],
        fields: [fields[0].as_ref(), fields[state].as_ref()],
        matches: &matches[state - 1],
        scene,
        truncation_m: band.truncation_m,
        // Of more states each shows some of the parts.
        parts: config.run.parts.filter(|_| count == 2),
    };
    let mut registrations = Vec::with_capacity(count - 1);
    for state in 1..count {
        let stage = stage_of("register", state, count);
        registrations.push(stages.kept(checkpoint, &stage, None, |_| search(state).register(state, &stage, config))?);
    }
    let found = match registrations.as_slice() {
        [one] => found_in_pair(one, &search(1), config, checkpoint, stages)?,
        several => found_in_all(several, &surfaces, &matches, config, checkpoint, stages)?,
    };
    let Found { articulation, registered, curve, mut notes, warnings } = found;
    let joints = stages.kept(checkpoint, "joints", None, |_| {
        // Corrections of poses leave each state a world frame that is a little its own.
        let moved: Vec<bool> = drifts.iter().map(|d| d.is_some() || capture.poses.changed()).collect();
        let still: Vec<_> = aligned.iter().enumerate().map(|(k, a)| still(a.as_ref(), &capture.poses, k)).collect();
        let pose_noise = capture.poses.noise(0);
        let seen = Seen { frames: &frames, surfaces: &surfaces, matches: &matches, moved: &moved, still: &still, pose_noise };
        Ok::<_, RunError>(joints(&seen, &articulation, &scene, config))
    })?;
    let parts = joints.len() + 1;
    let model = stages.kept(checkpoint, "assemble", None, |_| assemble(name, &surfaces, &articulation, joints, &band, config))?;
    let findings = validate(&model);
    if !findings.is_empty() {
        let list = findings.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
        return Err(RunError::stage("validate", format!("the model is not sound: {list}")));
    }
    cautions(&model).for_each(|c| stages.monitor.warn(c));
    if count > 2 {
        let said = more_views(&model);
        said.iter().for_each(|n| stages.monitor.tell(Event::Note { message: n.clone() }));
        notes.extend(said);
    }
    let part_count = PartCountReport::new(config.run.parts, parts, &curve, config.register.least_score);
    let starts = articulation.starts[1..].to_vec();
    let warnings = aligned.into_iter().flatten().map(|a| a.note).chain(warnings).collect();
    Ok(Twin { model, starts, registered, part_count, drifts, notes, warnings, replaced_engines })
}

/// What speaks against trusting the joints.
fn cautions(model: &ArticulatedModel) -> impl Iterator<Item = String> {
    model.joints.iter().flat_map(|j| j.evidence.cautions.iter().map(move |c| format!("{}: {c}", j.name)))
}

/// How well what stands still was brought to rest in state `k + 1`, by all of it: where its world was corrected, or its poses were.
fn still(aligned: Option<&Aligned>, poses: &PoseFindings, k: usize) -> Option<Matrix6<f64>> {
    aligned.map_or_else(|| poses.worlds.get(k)?.as_ref()?.covariance, |a| a.covariance)
}

/// The surface of every state.
struct Observed {
    surfaces: Vec<StateSurface>,
    /// Fields, where they were trained.
    fields: Vec<Option<ObjectField>>,
    /// Why the CPU engine took over, by state.
    replaced_engines: Vec<String>,
}

/// Surfaces and, where they are wanted, fields of all states, one after the other.
fn observe(
    frames: &[&[RgbdFrame]],
    scene: SceneBox,
    band: &Band,
    config: &Config,
    checkpoint: Option<&Checkpoint>,
    stages: &mut Stages,
) -> Result<Observed, RunError> {
    let occupancy = occupancy(frames, &scene, band);
    let noise = &config.capture.noise;
    let mut all =
        Observed { surfaces: Vec::with_capacity(frames.len()), fields: Vec::with_capacity(frames.len()), replaced_engines: Vec::new() };
    for (state, frames) in frames.iter().enumerate() {
        let field = if config.trains_fields() {
            let input = TrainInput { frames, scene, occupancy: &occupancy };
            let stage = format!("field/state{state}");
            let train = |m: &Monitor| train_field(state, &input, band, config, checkpoint, m);
            let trained = stages.run(&stage, Some(config.train.steps), train)?;
            all.replaced_engines.extend(trained.replaced.map(|why| format!("field of state {state} finished by the cpu engine: {why}")));
            Some(trained.field)
        } else {
            None
        };
        let geometry = field.as_ref().filter(|_| config.surface.source == SurfaceSource::Field);
        let stage = format!("surface/state{state}");
        // The volume is not kept: it takes twice the room of what is made of it, and as long to write as a tenth of its fusion.
        let surface = match stages.recall::<_, RunError>(checkpoint, &stage)? {
            Some(kept) => kept,
            None => {
                let fuse = |_: &Monitor| Ok::<_, RunError>(fuse(frames, &scene, band, noise, config.surface.nodes));
                let volume = stages.run(&format!("fusion/state{state}"), None, fuse)?;
                let surface = |_: &Monitor| state_surface(frames, &volume, geometry, &scene, band, noise, &config.surface);
                stages.kept(checkpoint, &stage, None, surface)?
            }
        };
        all.fields.push(field);
        all.surfaces.push(surface);
    }
    Ok(all)
}

/// Matches of state 0 with another state, in the world frame of state 0, and how that state was brought there if it had to be.
fn match_pair(
    state: usize,
    capture: &Capture,
    matcher: Option<&io::OnnxMatcher>,
    scene: &SceneBox,
    config: &Config,
    checkpoint: Option<&Checkpoint>,
    stages: &mut Stages,
) -> Result<(Vec<LiftedMatch>, Option<Aligned>), RunError> {
    let count = capture.states.len();
    let frames = [&capture.states[0][..], &capture.states[state][..]];
    let steps = matcher.map(|_| pairs(frames, &config.matching));
    let found = |m: &Monitor| pixel_matches(frames, &capture.matches, matcher, &config.matching, m);
    let matches = stages.kept(checkpoint, &stage_of("match", state, count), steps, found)?;
    let matches = lift(frames, &matches, &config.capture.noise);
    let mut aligned = stages.kept(checkpoint, &stage_of("align", state, count), None, |_| align(state, frames, &matches, scene, config))?;
    aligned.iter().for_each(|a| stages.monitor.warn(&a.note));
    let moved = aligned.as_mut().map(|a| std::mem::take(&mut a.matches));
    Ok((moved.unwrap_or(matches), aligned))
}

/// Cells near the object in any state.
fn occupancy(frames: &[&[RgbdFrame]], scene: &SceneBox, band: &Band) -> Occupancy {
    const EVERY: usize = 7;
    let points: Vec<_> = frames
        .iter()
        .flat_map(|s| s.iter())
        .flat_map(|f| (0..f.depth_m.len()).step_by(EVERY).filter(|&i| f.is_object(i)).filter_map(|i| f.world_point(i)))
        .collect();
    let cell_m = band.truncation_m.max(0.02 * scene.extent_m());
    Occupancy::new(scene, &points, cell_m, 2)
}

/// What a checkpoint belongs to.
fn fingerprint(request: &ReconstructRequest) -> Result<Fingerprint, RunError> {
    let failed = |e| RunError::stage("checkpoint", e);
    let mut all =
        Fingerprint::default().with("version", env!("CARGO_PKG_VERSION")).with_settings("config", &request.config).map_err(failed)?;
    if let Some(path) = &request.config.matching.onnx {
        all = all.with_source("matcher", path).map_err(failed)?;
    }
    for (i, source) in request.sources.iter().enumerate() {
        all = all.with_source(&format!("source{i}"), source).map_err(failed)?;
    }
    Ok(all)
}

fn facts(
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
            let alone = nearest_starts(&twin.model, &twin.registered);
            let identity = compare_starts(&twin.model, "identity", true, &twin.starts);
            [identity, compare_starts(&twin.model, "registration", false, &alone)].concat()
        }
    };
    let rendering = |p: &PhotoAndTwin| {
        let camera = p.cutout.as_ref().map(|(_, camera)| camera.clone());
        Some(Rendering { state: p.state, view: p.view.clone(), psnr_db: p.psnr_db?, photo: photo_path(p), camera })
    };
    RunFacts {
        input: InputFacts {
            paths: request.sources.iter().map(|p| p.display().to_string()).collect(),
            frames: capture.states.iter().map(Vec::len).collect(),
        },
        initialization,
        renderings: images.states.iter().filter_map(rendering).collect(),
        part_count: Some(twin.part_count.clone()),
        camera_poses: CameraPosesReport::of(&capture.poses.states),
        stages: stages.seconds.iter().map(|(name, seconds)| StageTime { name: name.clone(), seconds: *seconds }).collect(),
        versions: BTreeMap::from([("artitwin".to_owned(), env!("CARGO_PKG_VERSION").to_owned())]),
        seed: request.config.run.seed,
        preset: preset(&request.config.run.preset),
        config_digest: config_digest(&request.config),
        fingerprint: fingerprint.text(),
        device: device(request.config.run.engine, twin.replaced_engines.len(), capture.states.len()),
        notes: capture.notes.iter().chain(&twin.notes).chain(&twin.replaced_engines).cloned().collect(),
        warnings: capture.warnings.iter().cloned().chain(twin.warnings.iter().cloned()).chain(cautions(&twin.model)).collect(),
    }
}

/// Where the run folder holds the object as a view saw it.
fn photo_path(pair: &PhotoAndTwin) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '_' || c == '-' { c } else { '_' };
    format!("preview/photo_state{}_{}.png", pair.state, pair.view.chars().map(plain).collect::<String>())
}

/// A preset and what it costs.
fn preset(name: &str) -> String {
    preset_cost(name).map_or_else(|| name.to_owned(), |cost| format!("{name}: {cost}"))
}

/// A short digest of all settings.
fn config_digest(config: &Config) -> String {
    let text = serde_json::to_string(config).unwrap_or_default();
    let hash = text.bytes().fold(0xcbf2_9ce4_8422_2325u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
    format!("{hash:016x}")
}

/// What trained the `fields`, of which the CPU engine finished `replaced`.
fn device(engine: Engine, replaced: usize, fields: usize) -> String {
    let threads = rayon::current_num_threads();
    let cpu = format!("cpu engine ({})", InstructionSet::detect().name());
    let asked = match engine {
        Engine::Cpu => return format!("{cpu}, {threads} threads"),
        Engine::Burn => "burn on the CPU",
        Engine::Gpu => "burn on the GPU",
    };
    let by_cpu = if replaced > 0 { format!(", {replaced} of {fields} fields finished by the {cpu}") } else { String::new() };
    format!("{asked}, {threads} threads{by_cpu}")
}

/// Puts the run folder in its place, whole; under a name that says so where the check found an error.
fn write(
    model: &ArticulatedModel,
    files: &[ExportFile],
    found: &[CheckFinding],
    report: &Report,
    images: &ReportPictures,
    request: &ReconstructRequest,
    monitor: &Monitor,
) -> Result<PathBuf, RunError> {
    let failed = |e: Box<dyn std::error::Error + Send + Sync>| RunError::stage(OUTPUT_STAGE, e);
    let errors: Vec<String> = found.iter().filter(|f| f.level == Level::Error).map(ToString::to_string).collect();
    let place = if errors.is_empty() { request.place(&model.name) } else { request.rejected_place(&model.name) };
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
    committed.note().into_iter().for_each(|message| monitor.tell(Event::Note { message }));
    let folder = committed.folder;
    if errors.is_empty() {
        return Ok(folder);
    }
    let message =
        format!("a simulator would not load the model as it is meant; its files are in {}: {}", folder.display(), errors.join("; "));
    Err(RunError::stage("check", message))
}
