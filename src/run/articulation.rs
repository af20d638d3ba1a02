//! The stages that find parts and motions: registration of state 0 with every other state, what all pairs make together, and
//! on request consistency between two states.

use super::{Checkpoint, Event, Monitor, RunError, Stages, stage_rng, state_surface::StateSurface};
use crate::{
    articulate::{
        ArticulationProblem, ArticulationStart, ArticulationTrainer, ColorField, LiftedMatch, Registration, StateModel, StatePair,
        SurfaceRay, United, register, unite,
    },
    capture::{NoiseConfig, RgbdFrame, pixel_weights},
    config::{Config, Init},
    field::ObjectField,
    geometry::{Intrinsics, Pose, SceneBox},
};

/// What a pair of states gives to the search.
pub(super) struct Search<'a> {
    pub frames: [&'a [RgbdFrame]; 2],
    pub surfaces: [&'a StateSurface; 2],
    /// Fields of the states, where they were trained.
    pub fields: [Option<&'a ObjectField>; 2],
    pub matches: &'a [LiftedMatch],
    pub scene: SceneBox,
    pub truncation_m: f64,
    /// Number of parts, where it is given.
    pub parts: Option<usize>,
}

/// Parts and motions.
pub(super) struct Articulation {
    /// Motion of every part from state 0 to each other state, by state; the first part is the static one.
    pub motions: Vec<Vec<Pose>>,
    /// Motions to the last state that the search started from.
    pub starts: Vec<Pose>,
    /// Part of every surface sample of each state.
    pub labels: Vec<Vec<u8>>,
}

/// What is known of a state for registration: its surface, and which places are empty.
fn empty_in(surface: &StateSurface) -> impl Fn(&nalgebra::Point3<f64>) -> bool + Sync {
    let grid = &surface.free;
    move |p| grid.nearest(p).is_some_and(|i| grid.values[i])
}

/// Parts of more than two states from the registrations of state 0 with each other state.
///
/// # Errors
/// Fewer parts than asked for.
pub(super) fn unite_states(
    surfaces: &[StateSurface],
    matches: &[Vec<LiftedMatch>],
    found: &[Registration],
    config: &Config,
) -> Result<United, RunError> {
    let empty: Vec<_> = surfaces.iter().map(empty_in).collect();
    let mut pairs = Vec::with_capacity(found.len());
    for (k, found) in found.iter().enumerate() {
        pairs.push(StatePair { matches: &matches[k], surface: &surfaces[k + 1].samples, free: Some(&empty[k + 1]), found });
    }
    unite((&surfaces[0].samples, Some(&empty[0])), &pairs, config.run.parts, &config.register).map_err(|e| RunError::stage("register", e))
}

impl Search<'_> {
    /// Registration of matches and surfaces of state 0 and number `state`.
    ///
    /// # Errors
    /// No motion, no overlap, fewer motions than parts.
    pub fn register(&self, state: usize, stage: &str, config: &Config) -> Result<Registration, RunError> {
        let empty = self.surfaces.map(empty_in);
        let mut rng = stage_rng(config.run.seed, "register", state as u64 - 1);
        let samples = [&self.surfaces[0].samples, &self.surfaces[1].samples];
        register(self.matches, samples, [Some(&empty[0]), Some(&empty[1])], self.parts, &config.register, &mut rng)
            .map_err(|e| RunError::stage(stage, e))
    }

    /// Parts and motions of the registration, or what the consistency between the fields makes of them.
    ///
    /// # Errors
    /// Those of [`Self::optimise`].
    pub fn articulate(
        &self,
        start: &Registration,
        config: &Config,
        checkpoint: Option<&Checkpoint>,
        stages: &mut Stages,
    ) -> Result<Articulation, RunError> {
        match self.fields {
            [Some(field0), Some(field1)] if config.seeks_consistency() && start.motions.len() > 1 => {
                self.optimise([field0, field1], start, config, checkpoint, stages)
            }
            // A static object has nothing to refine.
            _ => Ok(Articulation { motions: vec![start.motions.clone()], starts: start.motions.clone(), labels: start.labels.to_vec() }),
        }
    }

    /// Segmentation fields and shared motions by consistency between the states (method.md 4).
    ///
    /// # Errors
    /// Unusable input, a stop request, a checkpoint that cannot be written.
    fn optimise(
        &self,
        colors: [&dyn ColorField; 2],
        start: &Registration,
        config: &Config,
        checkpoint: Option<&Checkpoint>,
        stages: &mut Stages,
    ) -> Result<Articulation, RunError> {
        let rays = [0, 1].map(|s| surface_rays(self.frames[s], &config.capture.noise, config.surface.points));
        let cameras: [Vec<(Intrinsics, Pose)>; 2] = self.frames.map(|f| f.iter().map(|f| (f.intrinsics, f.world_from_camera)).collect());
        let state = |s: usize| StateModel {
            sdf: &self.surfaces[s].sdf,
            visible: &self.surfaces[s].visible,
            color: colors[s],
            rays: &rays[s],
            cameras: &cameras[s],
        };
        let problem = ArticulationProblem {
            states: [state(0), state(1)],
            matches: self.matches,
            scene: self.scene,
            truncation_m: self.truncation_m,
            parts: start.motions.len(),
        };
        let labelled = [0, 1].map(|s| (self.surfaces[s].samples.points.clone(), start.labels[s].clone()));
        let from = match config.run.init {
            Init::Registration => ArticulationStart { motions: Some(&start.motions), labels: Some([&labelled[0], &labelled[1]]) },
            Init::Identity => ArticulationStart::default(),
        };
        let failed = |e| RunError::stage("articulate", e);
        let mut trainer = ArticulationTrainer::new(&problem, from, &config.articulation, config.run.seed).map_err(failed)?;
        stages.run("articulate", Some(trainer.total()), |monitor| {
            if let Some(saved) = checkpoint.and_then(|c| c.load(CHECKPOINT, monitor)) {
                trainer.restore(saved).map_err(failed)?;
            }
            run(&mut trainer, checkpoint, monitor)
        })?;
        let starts = from.motions.map_or_else(|| vec![Pose::identity(); start.motions.len()], <[Pose]>::to_vec);
        let labels = (0..2).map(|s| trainer.labels(s, &self.surfaces[s].samples.points)).collect();
        Ok(Articulation { motions: vec![trainer.motions()], starts, labels })
    }
}

/// File of the checkpoint.
const CHECKPOINT: &str = "articulate";

fn run(trainer: &mut ArticulationTrainer, checkpoint: Option<&Checkpoint>, monitor: &Monitor) -> Result<(), RunError> {
    while !trainer.done() {
        if let Err(stopped) = monitor.check() {
            if let Some(c) = checkpoint {
                c.save(CHECKPOINT, trainer.checkpoint())?;
            }
            return Err(stopped.into());
        }
        let losses = trainer.step();
        let (done, total) = (trainer.steps(), trainer.total());
        monitor.tell(Event::Step { stage: CHECKPOINT.to_owned(), done, total, loss: losses.total });
    }
    Ok(())
}

/// About `count` rays that hit the object, evenly over all usable pixels.
fn surface_rays(frames: &[RgbdFrame], noise: &NoiseConfig, count: usize) -> Vec<SurfaceRay> {
    let usable: Vec<(usize, usize)> = frames
        .iter()
        .enumerate()
        .flat_map(|(f, frame)| {
            let weights = pixel_weights(frame, noise);
            (0..weights.len()).filter(|&i| weights[i] > 0.0 && frame.is_object(i)).map(|i| (f, i)).collect::<Vec<_>>()
        })
        .collect();
    let stride = (usable.len() / count.max(1)).max(1);
    usable.into_iter().step_by(stride).map(|(f, i)| surface_ray(f, &frames[f], i, noise)).collect()
}

fn surface_ray(index: usize, frame: &RgbdFrame, pixel: usize, noise: &NoiseConfig) -> SurfaceRay {
    let depth_m = f64::from(frame.depth_m[pixel]);
    let (u, v) = (pixel % frame.intrinsics.width, pixel / frame.intrinsics.width);
    SurfaceRay {
        origin: frame.world_from_camera.translation.vector.into(),
        direction: frame.world_from_camera * frame.intrinsics.ray(u as f64, v as f64),
        depth_m,
        sigma_m: frame.sigma_m(pixel, noise),
        frame: index,
        rgb: frame.rgb[pixel].map(|c| f32::from(c) / 255.0),
    }
}
