//! From frames to a model: the steps of the method, in order.

use rayon::prelude::*;

use super::{
    RunError, Stages,
    alignment::{Aligned, Drift, align},
    assemble::assemble,
    found::{Found, find_parts, more_views},
    joints::joints,
    left_out::{left_out, warnings},
    radiance::{published_starts, radiance_model},
    scene::Scene,
    state::{State, observe},
};
use articulate::LEAST_SCORE;
use capture::Capture;
use common::note::{Note, NoteCode};
use config::{Config, Init, Method};
use export::{PartCountReport, screw_notes};
use geometry::Pose;
use io::OnnxMatcher;
use model::{ArticulatedModel, Link, renamed_model, validate};
use surface::{SolidFit, TriangleMesh};

/// A model, with facts for the report about how it was made.
pub struct Twin {
    /// The model.
    pub model: ArticulatedModel,
    /// Start of each moving part's refinement, as a motion to the last state, in the order of the joints.
    pub starts: Vec<Pose>,
    /// Motions from registration, in its own order.
    pub registered: Vec<Pose>,
    /// Fused surface of each state, in the world frame of state 0; empty if radiance fields were fitted.
    pub surfaces: Vec<TriangleMesh>,
    /// How the number of parts was found.
    pub part_count: PartCountReport,
    /// For every later state, the motion of still surfaces from state 0's world frame to its own, if they
    /// differed: the model is in state 0's.
    pub drifts: Vec<Option<Pose>>,
    /// Notes about choices, such as the number of parts.
    pub notes: Vec<Note>,
    /// Warnings about weak evidence.
    pub warnings: Vec<Note>,
    /// Why the CPU engine took over from the requested one, by state.
    pub replaced_engines: Vec<String>,
}

/// From frames to a model; accesses the disk only for checkpoints. States recorded in another world frame
/// than state 0 are moved into it.
///
/// # Errors
/// If a stage fails or is asked to stop.
pub fn reconstruct_twin(
    name: &str,
    capture: &mut Capture,
    matcher: Option<&OnnxMatcher>,
    config: &Config,
    stages: &mut Stages,
) -> Result<Twin, RunError> {
    // All states in the world frame of state 0 (docs/method.md 2.8, 4, 5).
    let (aligned, bounds) = align(capture, matcher, config, stages)?;
    let scene = Scene::of(capture, bounds, config);
    if config.run.method == Method::Radiance {
        return radiance_twin(name, capture, aligned, &scene, stages);
    }
    // The surface of each state by itself (docs/method.md 3).
    let states = observe(&capture.states, aligned, &scene, stages)?;
    // Parts and motions, state 0 with each other state (docs/method.md 6, 7).
    let mut found = find_parts(&states, &scene, stages)?;
    // Motions become joints in a tree, each with its evidence (docs/method.md 8).
    let joints = stages.kept("joints", None, |_| {
        Ok::<_, RunError>(joints(&states, &capture.poses, &found.articulation, &scene))
    })?;
    let left_out = left_out(&states, &found.articulation, &scene);
    let more = warnings(&states, &left_out);
    more.iter().for_each(|w| stages.monitor.warn(w));
    found.warnings.extend(more);
    // Surfaces of the parts from all states, links, masses, limits (docs/method.md 9, 10).
    let model = stages.kept("assemble", None, |_| {
        assemble(name, &states, &found.articulation, &left_out, joints, &scene)
    })?;
    let drifts: Vec<_> = states.iter().map(|s| s.drift.as_ref()).collect();
    let twin = twin(sound(model, config)?, &drifts, found, &scene, stages);
    let replaced_engines = replaced_engines(&states);
    Ok(Twin { replaced_engines, surfaces: states.into_iter().map(|s| s.surface.mesh).collect(), ..twin })
}

/// Images to a model (docs/method.md 12.11).
fn radiance_twin(
    name: &str,
    capture: &Capture,
    aligned: Vec<Aligned>,
    scene: &Scene,
    stages: &mut Stages,
) -> Result<Twin, RunError> {
    let drifts: Vec<Option<Drift>> = aligned.iter().map(|a| a.drift.clone()).collect();
    let found = match scene.config.run.init {
        Init::Identity => Found::of_starts(&published_starts(scene)),
        Init::Registration => find_parts(&observe(&capture.states, aligned, scene, stages)?, scene, stages)?,
    };
    let model = radiance_model(name, &capture.states, &found.articulation.starts[1..], scene, stages)?;
    let drifts: Vec<_> = drifts.iter().map(Option::as_ref).collect();
    Ok(twin(sound(model, scene.config)?, &drifts, found, scene, stages))
}

/// The model with the requested names; a defective one is refused.
fn sound(model: ArticulatedModel, config: &Config) -> Result<ArticulatedModel, RunError> {
    let findings = validate(&model);
    if findings.is_empty() {
        return Ok(renamed_model(model, config.export.names, &config.export.prefix));
    }
    let list = findings.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
    Err(RunError::stage("validate", format!("the model is not sound: {list}")))
}

/// States whose field was trained by another engine than requested, and why.
fn replaced_engines(states: &[State]) -> Vec<String> {
    let mut replaced = Vec::new();
    for (state, s) in states.iter().enumerate() {
        let why = s.field.as_ref().and_then(|field| field.replaced.as_ref());
        replaced.extend(why.map(|why| format!("field of state {state} finished by the cpu engine: {why}")));
    }
    replaced
}

/// The model, together with all facts for its report.
fn twin(
    model: ArticulatedModel,
    drifts: &[Option<&Drift>],
    found: Found,
    scene: &Scene,
    stages: &mut Stages,
) -> Twin {
    let Found { articulation, registered, curve, mut notes, warnings } = found;
    let off = solids_off(&model);
    cautions(&model).chain(off.iter().cloned()).for_each(|c| stages.monitor.warn(&c));
    if drifts.len() > 2 {
        let views = more_views(&model);
        views.iter().for_each(|n| stages.monitor.note(n));
        notes.extend(views);
    }
    let forms = screw_notes(&model, &scene.config.export);
    forms.iter().for_each(|n| stages.monitor.note(n));
    notes.extend(forms);
    let config = scene.config;
    let part_count = PartCountReport::new(config.run.parts, model.links.len(), &curve, LEAST_SCORE);
    let later: Vec<Option<&Drift>> = drifts.iter().skip(1).copied().collect();
    Twin {
        // The first part is the static one.
        starts: articulation.starts[1..].to_vec(),
        registered,
        part_count,
        drifts: later.iter().map(|d| d.map(|d| d.world_from_world0)).collect(),
        notes,
        warnings: later.iter().flatten().map(|d| d.note.clone()).chain(warnings).chain(off).collect(),
        replaced_engines: Vec::new(),
        surfaces: Vec::new(),
        model,
    }
}

/// Cautions about the joints.
pub(super) fn cautions(model: &ArticulatedModel) -> impl Iterator<Item = Note> {
    let link_name = |link: usize| model.links[link].name.clone();
    model
        .joints
        .iter()
        .flat_map(move |j| j.evidence.cautions.iter().map(move |c| c.note(link_name).about(&j.name)))
}

/// Warnings about parts whose collision solids do not fit their surface.
fn solids_off(model: &ArticulatedModel) -> Vec<Note> {
    model.links.par_iter().filter_map(solids_off_of_link).collect()
}

fn solids_off_of_link(link: &Link) -> Option<Note> {
    let fit = SolidFit::of_solids(&link.visual, &link.collision).filter(|fit| !fit.is_sound())?;
    Some(Note::new(NoteCode::SolidsOff, format!("{}: the collision solids {fit}", link.name)))
}
