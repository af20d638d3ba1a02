//! The stages of the method that uses only images: radiance fields of the parts with free motions, then again
//! with the joints found from these, and the model of both (docs/method.md 12.11).

use nalgebra::{Point3, Vector3};

use super::{Event, Monitor, RunError, StageStore, Stages, scene::Scene};
use articulate::{JointEstimate, TreeJointEstimate, published_joint};
use capture::RgbdFrame;
use field::{FieldError, HalfMotion, RadianceConfig, RadianceInput, RadianceModel, RadianceTrainer};
use geometry::Pose;
use model::{ArticulatedModel, MovingPart, build_model};
use surface::{TriangleMesh, keep_components};

/// Steps between two checks of the stop flag and the progress bar.
const REPORT_EVERY: usize = 10;

/// The model from the images of two states, with all parts on the static one. Free motions start from
/// `starts`, state1_from_state0 of the mobile parts in the world.
///
/// # Errors
/// If there are not two states, a state has no views, the loss is not a number, a part has no surface, a stop
/// is requested, or the checkpoint cannot be written.
pub(super) fn radiance_model(
    name: &str,
    states: &[Vec<RgbdFrame>],
    starts: &[Pose],
    scene: &Scene,
    stages: &mut Stages,
) -> Result<ArticulatedModel, RunError> {
    let [state0, state1] = states else {
        let message = format!("{} states were recorded; radiance fields are fitted to two", states.len());
        return Err(RunError::stage("radiance/free", message));
    };
    let states: [&[RgbdFrame]; 2] = [state0, state1];
    let config = RadianceConfig { parts: starts.len() + 1, ..scene.config.radiance.clone() };
    let input = RadianceInput { states, scene: scene.bounds };
    let seed = scene.config.run.seed;
    let free = trained("radiance/free", &config, stages, |stage| {
        let halves = starts.iter().map(|whole| HalfMotion::of_world(whole, &scene.bounds)).collect();
        RadianceTrainer::from_motions(&input, &config, halves, seed, stage)
    })?;
    // As the published code recommends: trained again with the joints of the free motions.
    let found = trained("radiance/typed", &config, stages, |stage| {
        RadianceTrainer::typed(&input, &config, &free, seed, stage)
    })?;
    stages.kept("assemble", None, |_| assemble(name, &found, &config, scene))
}

/// The published starts of the mobile parts: full motions in the world.
pub(super) fn published_starts(scene: &Scene) -> Vec<Pose> {
    // Two if no number is given; `checked_name` requires one if there may be more.
    let parts = scene.config.run.parts.filter(|_| scene.config.radiance.many_parts).unwrap_or(2);
    vec![HalfMotion::free_start().state1_from_state0(&scene.bounds); parts - 1]
}

/// The result of a trainer in a stage, continued from its checkpoint. A stop request writes a checkpoint.
fn trained<'a>(
    stage: &str,
    config: &RadianceConfig,
    stages: &mut Stages,
    trainer: impl FnOnce(&str) -> Result<RadianceTrainer<'a>, FieldError>,
) -> Result<RadianceModel, RunError> {
    let checkpoint = stages.checkpoint;
    stages.kept(stage, Some(config.steps), |monitor| {
        let trainer = trainer(stage).map_err(|e| RunError::stage(stage, e))?;
        train(trainer, stage, checkpoint, monitor)
    })
}

/// Trains to the end, or until asked to stop.
fn train(
    mut trainer: RadianceTrainer,
    stage: &str,
    checkpoint: Option<&StageStore>,
    monitor: &Monitor,
) -> Result<RadianceModel, RunError> {
    let failed = |error| RunError::stage(stage, error);
    // Not the stage's own file: that is for the result.
    let file = format!("{}-training", stage.replace('/', "-"));
    if let Some(saved) = checkpoint.and_then(|c| c.load(&file, monitor)) {
        trainer.restore(saved).map_err(failed)?;
    }
    let total = trainer.total_steps();
    while trainer.steps_done() < total {
        if let Err(stopped) = monitor.check() {
            checkpoint.map_or(Ok(()), |c| c.save(&file, &trainer.checkpoint()))?;
            return Err(stopped.into());
        }
        let mut loss = 0.0;
        for _ in 0..REPORT_EVERY.min(total - trainer.steps_done()) {
            loss = trainer.train_step().total_loss();
            if !loss.is_finite() {
                return Err(failed(FieldError::NotFinite { step: trainer.steps_done() }));
            }
        }
        monitor.report(Event::Step { stage: stage.to_owned(), done: trainer.steps_done(), total, loss });
    }
    Ok(trainer.trained_model())
}

/// Builds surfaces of the parts from their densities, and joints from their motions.
fn assemble(
    name: &str,
    found: &RadianceModel,
    config: &RadianceConfig,
    scene: &Scene,
) -> Result<ArticulatedModel, RunError> {
    let base = part_surface(found, 0, config, scene)?;
    let mut parts = Vec::with_capacity(found.motions.len());
    for (i, motion) in found.motions_to_state1().iter().enumerate() {
        let surface = part_surface(found, i + 1, config, scene)?;
        let TreeJointEstimate { parent, joint } = published_joint(motion, &middle(&surface));
        let JointEstimate { kind, axis, point, positions, evidence, .. } = joint;
        // The fields are undefined where no view looked.
        parts.push(MovingPart { parent, kind, axis, point, positions, evidence, surface, field: None });
    }
    Ok(build_model(name, base, parts, &scene.config.model))
}

/// The surface of a part from its density.
///
/// # Errors
/// If the density is nowhere above the threshold.
fn part_surface(
    found: &RadianceModel,
    part: usize,
    config: &RadianceConfig,
    scene: &Scene,
) -> Result<TriangleMesh, RunError> {
    let mesh = keep_components(&found.part_mesh(part, config.mesh_nodes), scene.config.surface.min_component);
    if mesh.is_empty() {
        let message = format!("part {part} has no surface: its density is nowhere above the threshold");
        return Err(RunError::stage("assemble", message));
    }
    Ok(mesh)
}

/// Mean of a surface's vertices.
fn middle(surface: &TriangleMesh) -> Point3<f64> {
    let sum: Vector3<f64> = surface.vertices.iter().map(|v| v.coords.cast::<f64>()).sum();
    Point3::from(sum / surface.vertices.len().max(1) as f64)
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, atomic::AtomicBool, mpsc};

    use super::*;
    use crate::Fingerprint;
    use field::FieldConfig;
    use geometry::{Intrinsics, SceneBox};

    /// A gray wall at 1 m.
    fn frame() -> RgbdFrame {
        let intrinsics = Intrinsics { width: 8, height: 8, fx: 8.0, fy: 8.0, cx: 3.5, cy: 3.5 };
        RgbdFrame {
            id: String::new(),
            stamp_nanos: 0,
            intrinsics,
            world_from_camera: Pose::identity(),
            rgb: vec![[90; 3]; 64],
            depth_m: vec![1.0; 64],
            mask: None,
            readings: Vec::new(),
        }
    }

    #[test]
    fn a_training_that_was_stopped_goes_on_from_there() {
        let folder = tempfile::tempdir().unwrap();
        let checkpoint = StageStore::open(folder.path(), Fingerprint::default()).unwrap();
        let field = FieldConfig {
            levels: 2,
            base_resolution: 4,
            finest_resolution: 8,
            log2_table_size: 10,
            hidden: 8,
        };
        let config = RadianceConfig { field, steps: 25, rays: 4, samples: 16, ..RadianceConfig::default() };
        let frames = [frame()];
        let scene = SceneBox { center: Point3::new(0.0, 0.0, 1.0), scale: 1.0 };
        let input = RadianceInput { states: [&frames, &frames], scene };
        let trainer = || RadianceTrainer::free(&input, &config, 1, "radiance/free").unwrap();
        let run = |stop: &Arc<AtomicBool>, checkpoint| {
            let (sender, events) = mpsc::channel();
            let result =
                train(trainer(), "radiance/free", checkpoint, &Monitor::new(sender, Arc::clone(stop)));
            (result, events.iter().filter(|e| matches!(e, Event::Step { .. })).count())
        };
        let go: Arc<AtomicBool> = Arc::default();
        let (whole, reports) = run(&go, None);
        assert_eq!(reports, 3, "of 10, 10 and 5 steps");
        // What a stop leaves after the first ten steps.
        let mut part = trainer();
        (0..10).for_each(|_| {
            part.train_step();
        });
        checkpoint.save("radiance-free-training", &part.checkpoint()).unwrap();
        let stopped = run(&Arc::new(AtomicBool::new(true)), Some(&checkpoint)).0;
        assert!(matches!(stopped, Err(RunError::Cancelled(_))));
        let (resumed, reports) = run(&go, Some(&checkpoint));
        assert!(reports == 2 && resumed.unwrap() == whole.unwrap());
    }
}
