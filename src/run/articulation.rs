//! The stages of parts and motions: registration of state 0 with every other state, the union of all pairs
//! and, on request, refinement by consistency between two states.

use super::{
    Event, Monitor, RunError, StageStore, Stages, scene::Scene, state::State, state_surface::StateSurface,
};
use articulate::{
    ArticulationProblem, ArticulationStart, ArticulationTrainer, FreeSpace, RegisterMethod, Registrar,
    Registration, StateModel, StatePair, SurfaceRay, United, register_by_difference, unite,
};
use capture::{NoiseConfig, RgbdFrame, object_weights};
use config::Init;
use geometry::{Intrinsics, Pose};
use numeric::random::stage_rng;
use surface::ColorField;

/// Parts and motions.
pub(super) struct Articulation {
    /// The parts in every state.
    pub states: Vec<PartsOfState>,
    /// Motions to the last state from which refinement started.
    pub starts: Vec<Pose>,
}

/// The parts in one state.
pub(super) struct PartsOfState {
    /// Motion of every part from state 0 to this one; the first part is the static one.
    pub motions: Vec<Pose>,
    /// Part of every surface sample.
    pub labels: Vec<u8>,
}

impl Articulation {
    /// From motions from state 0 to every other state, and labels in every state.
    pub(crate) fn new(motions: Vec<Vec<Pose>>, labels: Vec<Vec<u8>>, starts: Vec<Pose>) -> Self {
        let at_rest = vec![Pose::identity(); motions.first().map_or(1, Vec::len)];
        let motions = std::iter::once(at_rest).chain(motions);
        let states = motions.zip(labels).map(|(motions, labels)| PartsOfState { motions, labels });
        Self { states: states.collect(), starts }
    }

    /// Number of parts, the static one included.
    pub(crate) fn parts(&self) -> usize {
        self.states.first().map_or(1, |s| s.motions.len())
    }
}

/// A test whether places were seen empty in a state.
fn empty_in(surface: &StateSurface) -> impl Fn(&nalgebra::Point3<f64>) -> bool + Sync {
    let grid = &surface.free;
    move |p| grid.nearest_node(p).is_some_and(|i| grid.values[i])
}

/// Registers the matches and surfaces of state 0 and of state number `state`, for a given number of `parts`
/// or for as many as the evidence supports.
///
/// # Errors
/// No motion, no overlap, fewer motions than parts; a stop request, an unwritable checkpoint.
pub(super) fn register_state(
    states: &[State],
    state: usize,
    stage: &str,
    parts: Option<usize>,
    scene: &Scene,
    checkpoint: Option<&StageStore>,
    monitor: &Monitor,
) -> Result<Registration, RunError> {
    let failed = |e| RunError::stage(stage, e);
    let pair = [&states[0].surface, &states[state].surface];
    let surfaces = pair.map(|s| &s.samples);
    if scene.config.register.method == RegisterMethod::Difference {
        // Without a number of parts there are two, the fewest.
        return register_by_difference(surfaces, parts.unwrap_or(2)).map_err(failed);
    }
    let empty = pair.map(empty_in);
    // A random stream for each state, so draws for one do not depend on the others.
    let mut rng = stage_rng(scene.config.run.seed, "register", state as u64 - 1);
    let free: [Option<FreeSpace>; 2] = [Some(&empty[0]), Some(&empty[1])];
    let matches = &states[state].matches;
    let config = &scene.config.register;
    let mut search = Registrar::new(matches, surfaces, free, parts, config, &mut rng).map_err(failed)?;
    let file = format!("{}-search", stage.replace('/', "-"));
    if let Some(saved) = checkpoint.and_then(|c| c.load(&file, monitor)) {
        search.restore(saved);
    }
    while search.done_steps() < search.total_steps() {
        // The search is kept when stopped and continues from there.
        if let Err(stopped) = monitor.check() {
            checkpoint.map_or(Ok(()), |c| c.save(&file, search.checkpoint()))?;
            return Err(stopped.into());
        }
        search.step().map_err(failed)?;
    }
    Ok(search.registration())
}

/// Parts of more than two states from the registrations of state 0 with each other state.
///
/// # Errors
/// Fewer parts than asked for.
pub(super) fn unite_states(
    states: &[State],
    found: &[Registration],
    scene: &Scene,
) -> Result<United, RunError> {
    let empty: Vec<_> = states.iter().map(|s| empty_in(&s.surface)).collect();
    let mut pairs = Vec::with_capacity(found.len());
    for ((state, empty), found) in states.iter().zip(&empty).skip(1).zip(found) {
        let matches = &state.matches;
        let surface = &state.surface.samples;
        pairs.push(StatePair { matches, surface, free: Some(empty), found });
    }
    unite(&states[0].surface.samples, Some(&empty[0]), &pairs, scene.config.run.parts)
        .map_err(|e| RunError::stage("register", e))
}

/// Parts and motions from the registration of two states, refined by consistency between their fields if
/// requested.
///
/// # Errors
/// Those of [`optimise`].
pub(super) fn articulate(
    states: [&State; 2],
    start: &Registration,
    scene: &Scene,
    stages: &mut Stages,
) -> Result<Articulation, RunError> {
    match states.map(State::field) {
        // Consistency is defined between two fields; `checked_name` refused more states.
        [Some(field0), Some(field1)] if scene.config.seeks_consistency() && start.motions.len() > 1 => {
            optimise(states, [field0, field1], start, scene, stages)
        }
        // A static object has nothing to refine.
        _ => {
            let motions = start.motions.clone();
            Ok(Articulation::new(vec![motions.clone()], start.labels.to_vec(), motions))
        }
    }
}

/// Finds segmentation fields and shared motions by consistency between the states (docs/method.md 12.8).
///
/// # Errors
/// Unusable input, a stop request, an unwritable checkpoint.
fn optimise(
    states: [&State; 2],
    colors: [&dyn ColorField; 2],
    start: &Registration,
    scene: &Scene,
    stages: &mut Stages,
) -> Result<Articulation, RunError> {
    let config = scene.config;
    let checkpoint = stages.checkpoint;
    // Rays, distances and colors of both states, all in the world of state 0.
    let rays = states.map(|s| surface_rays(s.frames, &scene.noise, config.surface.points));
    let cameras: [Vec<(Intrinsics, Pose)>; 2] =
        states.map(|s| s.frames.iter().map(|f| (f.intrinsics, f.world_from_camera)).collect());
    let problem = ArticulationProblem {
        states: [0, 1].map(|s| StateModel {
            sdf: &states[s].surface.sdf,
            visible: &states[s].surface.visible,
            color: colors[s],
            rays: &rays[s],
            cameras: &cameras[s],
        }),
        matches: &states[1].matches,
        scene: scene.bounds,
        truncation_m: scene.band.truncation_m,
        parts: start.motions.len(),
    };
    let labelled = [0, 1].map(|s| (states[s].surface.samples.points.clone(), start.labels[s].clone()));
    let from = match config.run.init {
        Init::Registration => {
            ArticulationStart { motions: Some(&start.motions), labels: Some([&labelled[0], &labelled[1]]) }
        }
        // As published: no motion and no labels to start from.
        Init::Identity => ArticulationStart::default(),
    };
    let failed = |e| RunError::stage("articulate", e);
    let mut trainer =
        ArticulationTrainer::new(&problem, from, &config.articulation, config.run.seed).map_err(failed)?;
    stages.run("articulate", Some(trainer.total_steps()), |monitor| {
        if let Some(saved) = checkpoint.and_then(|c| c.load(CHECKPOINT, monitor)) {
            trainer.restore(saved).map_err(failed)?;
        }
        run(&mut trainer, checkpoint, monitor)
    })?;
    let starts = from.motions.map_or_else(|| vec![Pose::identity(); start.motions.len()], <[Pose]>::to_vec);
    let labels = match config.run.init {
        // Consistency improves only the motions: labels from the evidence on surfaces stay.
        Init::Registration => start.labels.to_vec(),
        Init::Identity => (0..2).map(|s| trainer.labels(s, &states[s].surface.samples.points)).collect(),
    };
    Ok(Articulation::new(vec![trainer.motions()], labels, starts))
}

/// Name of the checkpoint file.
const CHECKPOINT: &str = "articulate";

fn run(
    trainer: &mut ArticulationTrainer,
    checkpoint: Option<&StageStore>,
    monitor: &Monitor,
) -> Result<(), RunError> {
    while !trainer.is_done() {
        // Saved when stopped, so the steps need not start over.
        if let Err(stopped) = monitor.check() {
            if let Some(c) = checkpoint {
                c.save(CHECKPOINT, trainer.checkpoint())?;
            }
            return Err(stopped.into());
        }
        let losses = trainer.step();
        let done = trainer.steps();
        let total = trainer.total_steps();
        monitor.report(Event::Step { stage: CHECKPOINT.to_owned(), done, total, loss: losses.total });
    }
    Ok(())
}

/// About `count` rays to the object, spread evenly over all usable pixels.
fn surface_rays(frames: &[RgbdFrame], noise: &NoiseConfig, count: usize) -> Vec<SurfaceRay> {
    let usable: Vec<(usize, usize)> = frames
        .iter()
        .enumerate()
        .flat_map(|(f, frame)| {
            let weights = object_weights(frame, noise);
            (0..weights.len()).filter(|&i| weights[i] > 0.0).map(|i| (f, i)).collect::<Vec<_>>()
        })
        .collect();
    // Evenly over all frames, without a draw.
    let stride = (usable.len() / count.max(1)).max(1);
    usable.into_iter().step_by(stride).map(|(f, i)| surface_ray(f, &frames[f], i)).collect()
}

fn surface_ray(index: usize, frame: &RgbdFrame, pixel: usize) -> SurfaceRay {
    let depth_m = f64::from(frame.depth_m[pixel]);
    let u = pixel % frame.intrinsics.width;
    let v = pixel / frame.intrinsics.width;
    SurfaceRay {
        origin: frame.world_from_camera.translation.vector.into(),
        // Of unit depth, not of unit length, as depth is along the optical axis.
        direction: frame.world_from_camera * frame.intrinsics.ray_at(u as f64, v as f64),
        depth_m,
        frame: index,
        rgb: frame.rgb[pixel].map(|c| f32::from(c) / 255.0),
    }
}
