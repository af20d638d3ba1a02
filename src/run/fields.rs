//! The stage that trains the object field of one state.

use super::{Checkpoint, Event, Monitor, RunError, state_surface::Band};
use crate::{
    config::{Config, Engine},
    field::{BurnEngine, CpuEngine, EngineState, FieldEngine, FieldTrainer, ObjectField, TrainConfig, TrainInput},
};

/// Steps between two looks at the clock, the bar and the stop flag.
const REPORT_EVERY: usize = 10;

/// Trains the field of a state, or takes it up where a checkpoint left it. A stop request writes a checkpoint.
///
/// # Errors
/// Unusable input or settings, an engine that is not there, a stop request, a checkpoint that cannot be written.
pub(super) fn train_field(
    state: usize,
    input: &TrainInput,
    band: &Band,
    config: &Config,
    checkpoint: Option<&Checkpoint>,
    monitor: &Monitor,
) -> Result<ObjectField, RunError> {
    let stage = format!("field/state{state}");
    let factory = |state| engine(config.run.engine, state, monitor);
    let failed = |error| RunError::stage(stage.clone(), error);
    let settings = TrainConfig { truncation_m: Some(band.truncation_m), noise: config.capture.noise, ..config.train.clone() };
    let mut trainer = FieldTrainer::with_engine(input, &settings, config.run.seed, &stage, &factory).map_err(failed)?;
    let file = format!("field-state{state}");
    if let Some(saved) = checkpoint.and_then(|c| c.load(&file, monitor)) {
        trainer.restore(saved, &factory).map_err(failed)?;
    }
    let total = trainer.total();
    let mut recent = 0.0;
    while trainer.done() < total {
        if let Err(stopped) = monitor.check() {
            if let Some(c) = checkpoint {
                c.save(&file, &trainer.checkpoint())?;
            }
            return Err(stopped.into());
        }
        for _ in 0..REPORT_EVERY.min(total - trainer.done()) {
            let losses = trainer.step();
            recent = losses.sdf + losses.color;
        }
        monitor.tell(Event::Step { stage: stage.clone(), done: trainer.done(), total, loss: recent });
    }
    if let Some(c) = checkpoint {
        c.save(&file, &trainer.checkpoint())?;
    }
    Ok(trainer.field())
}

/// The engine that was asked for; one that is not there is told and replaced by the CPU engine.
fn engine(kind: Engine, state: EngineState, monitor: &Monitor) -> Box<dyn FieldEngine> {
    let made = match kind {
        Engine::Cpu => return Box::new(CpuEngine::resume(state)),
        Engine::Burn => BurnEngine::flex(state.clone()),
        Engine::Gpu => BurnEngine::wgpu(state.clone()),
    };
    match made {
        Ok(engine) => Box::new(engine),
        Err(error) => {
            monitor.warn(format!("{error}; the cpu engine is used instead"));
            Box::new(CpuEngine::resume(state))
        }
    }
}
