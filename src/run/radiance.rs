//! The stages of the method that explains the images alone: radiance fields of the parts with free motions,
//! again with the joints that these show, and the model of both (docs/method.md 12.11).

use nalgebra::{Point3, Vector3};

use super::{Checkpoint, Event, Monitor, RunError, Stages, scene::Scene};
use crate::{
    articulate::{JointEstimate, TreeJointEstimate, published_joint},
    capture::RgbdFrame,
    field::{FieldError, HalfMotion, RadianceConfig, RadianceInput, RadianceModel, RadianceTrainer},
    geometry::Pose,
    model::{ArticulatedModel, MovingPart, build},
    surface::{TriangleMesh, keep_components},
};

/// Steps between two looks at the stop flag and the bar.
const REPORT_EVERY: usize = 10;

/// The model that the images of two states show, all parts on the static one. Free motions start from
/// `starts`, state1_from_state0 of the mobile parts in the world.
///
/// # Errors
/// No number of parts where many are sought; a state that no view shows; a loss that is no number; a part
/// without a surface; a stop request, a checkpoint that cannot be written.
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
    // As recommended by the published code: the free motions' joints, trained anew.
    let found = trained("radiance/typed", &config, stages, |stage| {
        RadianceTrainer::typed(&input, &config, &free, seed, stage)
    })?;
    stages.kept("assemble", None, |_| assemble(name, &found, &config, scene))
}

/// The published starts of the mobile parts: whole motions in the world.
///
/// # Errors
/// No number of parts where many are sought.
pub(super) fn published_starts(scene: &Scene) -> Result<Vec<Pose>, RunError> {
    let parts = match (scene.config.radiance.many_parts, scene.config.run.parts) {
        (false, _) => 2,
        (true, Some(parts)) => parts,
        (true, None) => {
            let message = "the method does not find the number of parts; give it with --parts N";
            return Err(RunError::stage("radiance/free", message));
        }
    };
    Ok(vec![HalfMotion::free().state1_from_state0(&scene.bounds); parts - 1])
}

/// What a trainer finds in a stage, taken up where a checkpoint left it. A stop request writes a checkpoint.
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
    checkpoint: Option<&Checkpoint>,
    monitor: &Monitor,
) -> Result<RadianceModel, RunError> {
    let failed = |error| RunError::stage(stage, error);
    // Not the stage's own file, which holds the result.
    let file = format!("{}-training", stage.replace('/', "-"));
    if let Some(saved) = checkpoint.and_then(|c| c.load(&file, monitor)) {
        trainer.restore(saved).map_err(failed)?;
    }
    let total = trainer.total();
    while trainer.done() < total {
        if let Err(stopped) = monitor.check() {
            checkpoint.map_or(Ok(()), |c| c.save(&file, &trainer.checkpoint()))?;
            return Err(stopped.into());
        }
        let mut loss = 0.0;
        for _ in 0..REPORT_EVERY.min(total - trainer.done()) {
            loss = trainer.step().total();
            if !loss.is_finite() {
                return Err(failed(FieldError::NotFinite { step: trainer.done() }));
            }
        }
        monitor.report(Event::Step { stage: stage.to_owned(), done: trainer.done(), total, loss });
    }
    Ok(trainer.model())
}

/// Surfaces of the parts by their densities, joints by their motions.
fn assemble(
    name: &str,
    found: &RadianceModel,
    config: &RadianceConfig,
    scene: &Scene,
) -> Result<ArticulatedModel, RunError> {
    let surface = |part: usize| {
        let mesh = keep_components(&found.mesh(part, config.mesh_nodes), scene.config.surface.min_component);
        if mesh.is_empty() {
            let message = format!("part {part} has no surface: its density is nowhere above the threshold");
            return Err(RunError::stage("assemble", message));
        }
        Ok(mesh)
    };
    let base = surface(0)?;
    let mut parts = Vec::with_capacity(found.motions.len());
    for (i, motion) in found.motions_to_state1().iter().enumerate() {
        let surface = surface(i + 1)?;
        let TreeJointEstimate { parent, joint } = published_joint(motion, &middle(&surface));
        let JointEstimate { kind, axis, point, positions, evidence, .. } = joint;
        // The fields say nothing of what no view saw.
        parts.push(MovingPart { parent, kind, axis, point, positions, evidence, surface, field: None });
    }
    Ok(build(name, base, parts, &scene.config.model))
}

/// Mean of a surface's vertices.
fn middle(surface: &TriangleMesh) -> Point3<f64> {
    let sum: Vector3<f64> = surface.vertices.iter().map(|v| v.coords.cast::<f64>()).sum();
    Point3::from(sum / surface.vertices.len().max(1) as f64)
}
