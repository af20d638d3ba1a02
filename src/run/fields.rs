//! The stage that trains the object field of one state.

use std::cell::RefCell;

use super::{Cancelled, Event, Monitor, RunError, StageStore, scene::Scene};
use common::note::{Note, NoteCode};
use config::Engine;
use field::{
    BurnEngine, CpuEngine, EngineError, EngineState, FieldEngine, FieldError, FieldTrainer, ObjectField,
    TrainConfig, TrainInput, TrainerCheckpoint,
};

/// Steps between two checks of the clock, the progress bar and the stop flag.
const REPORT_EVERY: usize = 10;
/// Largest number of steps lost if a device fails.
const KEEP_EVERY: usize = 200;

/// A trained field and its engine.
pub(super) struct TrainedField {
    pub field: ObjectField,
    /// Why the CPU engine replaced the requested one, if it did.
    pub replaced: Option<String>,
}

/// Trains the field of a state in a stage, or continues from a checkpoint. A stop request writes a
/// checkpoint.
///
/// # Errors
/// If input or settings are unusable, the loss is not a number, a stop is requested, or the checkpoint cannot
/// be written.
pub(super) fn train_field(
    stage: &str,
    input: &TrainInput,
    scene: &Scene,
    checkpoint: Option<&StageStore>,
    monitor: &Monitor,
) -> Result<TrainedField, RunError> {
    let config = scene.config;
    let stage = stage.to_owned();
    let settings = TrainConfig {
        truncation_m: Some(scene.band.truncation_m),
        noise: scene.noise,
        ..config.train.clone()
    };
    let kind = config.run.engine;
    let start = |state| engine(kind, state);
    let start: Option<Start> = if kind == Engine::Cpu { None } else { Some(&start) };
    Training { stage, start, checkpoint, monitor, replaced: RefCell::default() }.run(
        input,
        &settings,
        config.run.seed,
    )
}

/// Creates an engine other than the CPU engine, or says why it cannot.
type Start<'a> = &'a dyn Fn(EngineState) -> Result<Box<dyn FieldEngine>, EngineError>;

/// Why an engine or its result cannot be used.
#[derive(Debug, thiserror::Error)]
enum EngineFault {
    #[error(transparent)]
    Engine(#[from] EngineError),
    #[error("the loss or a parameter is not a finite number after {0} steps")]
    NotFinite(usize),
}

fn engine(kind: Engine, state: EngineState) -> Result<Box<dyn FieldEngine>, EngineError> {
    let made = match kind {
        Engine::Cpu => return Ok(cpu(state)),
        Engine::Burn => BurnEngine::flex(state),
        Engine::Gpu => BurnEngine::wgpu(state),
    };
    made.map(|engine| -> Box<dyn FieldEngine> { Box::new(engine) })
}

fn cpu(state: EngineState) -> Box<dyn FieldEngine> {
    Box::new(CpuEngine::resume(state))
}

/// Training that survives its engine: if the engine fails, the CPU engine continues from the last saved
/// state.
struct Training<'a> {
    stage: String,
    /// How to start the engine; `None` for the CPU engine.
    start: Option<Start<'a>>,
    checkpoint: Option<&'a StageStore>,
    monitor: &'a Monitor,
    /// Why the engine was replaced by the CPU engine.
    replaced: RefCell<Option<String>>,
}

impl Training<'_> {
    fn run(self, input: &TrainInput, settings: &TrainConfig, seed: u64) -> Result<TrainedField, RunError> {
        let failed = |error: FieldError| RunError::stage(self.stage.clone(), error);
        let file = self.stage.replace('/', "-");
        let factory = |state| self.make(state);
        let mut trainer =
            FieldTrainer::with_engine(input, settings, seed, &self.stage, &factory).map_err(failed)?;
        if let Some(saved) = self.checkpoint.and_then(|c| c.load(&file, self.monitor)) {
            trainer.restore(saved, &factory).map_err(failed)?;
        }
        // From the start: an engine may fail before the first state is kept.
        let mut kept = trainer.checkpoint();
        let stopped = loop {
            match self.advance(&mut trainer, &mut kept) {
                Ok(stopped) => break stopped,
                // No further engine is left, and the same steps would fail again.
                Err(_) if self.on_cpu() => {
                    return Err(failed(FieldError::NotFinite { step: trainer.steps_done() }));
                }
                Err(why) => {
                    self.replace(format!("{why}; {} of {} steps are kept", kept.done, trainer.total_steps()));
                    trainer.restore(kept.clone(), &factory).map_err(failed)?;
                }
            }
        };
        if let Some(c) = self.checkpoint {
            // Saved also when training is done, so a later stop still finds the field.
            c.save(&file, &kept)?;
        }
        stopped.map_or(Ok(()), Err)?;
        Ok(TrainedField { field: trainer.trained_field(), replaced: self.replaced.into_inner() })
    }

    /// Trains to the end or until asked to stop; `kept` receives the last good state, also before an error.
    ///
    /// # Errors
    /// Why the engine or its result cannot be used.
    fn advance(
        &self,
        trainer: &mut FieldTrainer,
        kept: &mut TrainerCheckpoint,
    ) -> Result<Option<Cancelled>, EngineFault> {
        let total = trainer.total_steps();
        let mut recent = 0.0;
        while trainer.steps_done() < total {
            // Between steps, when the state can be read back whole.
            if let Err(stopped) = self.monitor.check() {
                *kept = sound(trainer)?;
                return Ok(Some(stopped));
            }
            for _ in 0..REPORT_EVERY.min(total - trainer.steps_done()) {
                let losses = trainer.train_step();
                recent = losses.sdf + losses.color;
                if !recent.is_finite() {
                    return Err(failure(trainer));
                }
            }
            // A device can be lost with its memory, the CPU engine cannot.
            if !self.on_cpu() && trainer.steps_done() >= kept.done + KEEP_EVERY {
                *kept = sound(trainer)?;
            }
            self.monitor.report(Event::Step {
                stage: self.stage.clone(),
                done: trainer.steps_done(),
                total,
                loss: recent,
            });
        }
        *kept = sound(trainer)?;
        Ok(None)
    }

    fn on_cpu(&self) -> bool {
        self.start.is_none() || self.replaced.borrow().is_some()
    }

    fn make(&self, state: EngineState) -> Box<dyn FieldEngine> {
        match self.start {
            Some(start) if !self.on_cpu() => start(state.clone()).unwrap_or_else(|why| {
                self.replace(why.to_string());
                cpu(state)
            }),
            _ => cpu(state),
        }
    }

    fn replace(&self, why: String) {
        let text = format!("{}: {why}; the cpu engine is used instead", self.stage);
        self.monitor.warn(&Note::new(NoteCode::EngineReplaced, text));
        self.replaced.replace(Some(why));
    }
}

/// The state of a training with a working engine and finite parameters.
fn sound(trainer: &FieldTrainer) -> Result<TrainerCheckpoint, EngineFault> {
    let now = trainer.checkpoint();
    // The loss may be finite although a parameter is not, so all are checked before the state is kept.
    let params = &now.engine.params;
    let layers = params.geometry.iter().chain(&params.color);
    let sound = trainer.failure().is_none()
        && are_finite(&params.table)
        && layers.clone().all(|l| are_finite(&l.weights) && are_finite(&l.biases));
    if sound { Ok(now) } else { Err(failure(trainer)) }
}

fn are_finite(values: &[f32]) -> bool {
    values.iter().all(|v| v.is_finite())
}

fn failure(trainer: &FieldTrainer) -> EngineFault {
    trainer.failure().map_or(EngineFault::NotFinite(trainer.steps_done()), |error| error.clone().into())
}

#[cfg(test)]
#[path = "fields_tests.rs"]
mod tests;
