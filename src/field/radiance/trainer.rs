//! Step-by-step training of the parts' fields and motions.

use rand_core::Rng;
use serde::{Deserialize, Serialize};

use super::engine::RadianceEngine;
use super::loss::RadianceLosses;
use super::motion_adam::MotionState;
use super::ray_batch::RaySource;
use super::{HalfMotion, RadianceConfig, RadianceModel};
use crate::{EngineState, FieldError, FieldParams};
use capture::RgbdFrame;
use geometry::SceneBox;
use numeric::random::stage_rng;

/// Input for training the fields.
#[derive(Clone, Copy)]
pub struct RadianceInput<'a> {
    /// Masked frames of state 0 and of state 1; depth is used if its loss has a weight.
    pub states: [&'a [RgbdFrame]; 2],
    /// The normalised frame: in both states, the object spans 0.9 of its cube.
    pub scene: SceneBox,
}

/// Trains the fields and motions of an object's parts. Every step depends only on parameters, seed and step
/// number, so that a resumed run ends with exactly the parameters of an uninterrupted one.
///
/// As recommended for PARIS, training has two phases: [`Self::free`] finds free motions, and [`Self::typed`]
/// continues with revolute or prismatic joints derived from them.
pub struct RadianceTrainer<'a> {
    config: RadianceConfig,
    scene: SceneBox,
    source: RaySource<'a>,
    engine: RadianceEngine,
    motions: MotionState,
    seed: u64,
    stage: String,
    done: usize,
}

/// State of an interrupted training, apart from input and configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RadianceCheckpoint {
    /// Parameters and moments of every part's field.
    pub fields: Vec<EngineState>,
    /// Half motions of the mobile parts with Adam's moments.
    motions: MotionState,
    /// Number of steps done.
    pub done: usize,
}

impl<'a> RadianceTrainer<'a> {
    /// Starts with random fields and free motions at their published start. `stage` names the random streams.
    ///
    /// # Errors
    /// [`FieldError`]: a value out of range, or a state without frames that show the cube.
    pub fn free(
        input: &RadianceInput<'a>,
        config: &RadianceConfig,
        seed: u64,
        stage: &str,
    ) -> Result<Self, FieldError> {
        let motions = vec![HalfMotion::free_start(); config.parts.saturating_sub(1)];
        Self::from_motions(input, config, motions, seed, stage)
    }

    /// Starts with typed joints from the motions of a model, and with random fields.
    ///
    /// # Errors
    /// [`FieldError`]: a value out of range, a different number of parts, or a state without frames that show
    /// the cube.
    pub fn typed(
        input: &RadianceInput<'a>,
        config: &RadianceConfig,
        found: &RadianceModel,
        seed: u64,
        stage: &str,
    ) -> Result<Self, FieldError> {
        let motions = found.motions.iter().map(HalfMotion::typed_joint).collect();
        Self::from_motions(input, config, motions, seed, stage)
    }

    /// Starts with random fields and the given half motions of the mobile parts.
    ///
    /// # Errors
    /// [`FieldError`]: a value out of range, a wrong number of motions, or a state without frames that show
    /// the cube.
    pub fn from_motions(
        input: &RadianceInput<'a>,
        config: &RadianceConfig,
        motions: Vec<HalfMotion>,
        seed: u64,
        stage: &str,
    ) -> Result<Self, FieldError> {
        config.validate()?;
        expect_count("motions", motions.len(), config.parts - 1)?;
        let source = RaySource::new(input.states, input.scene, config)?;
        let mut fields = Vec::with_capacity(config.parts);
        for part in 0..config.parts {
            let mut rng = stage_rng(seed, &format!("{stage}/init"), part as u64);
            fields.push(EngineState::untrained(FieldParams::random_params(&config.field, &mut rng)));
        }
        Ok(Self {
            config: config.clone(),
            scene: input.scene,
            source,
            engine: RadianceEngine::new(fields),
            motions: MotionState::new(motions),
            seed,
            stage: stage.to_owned(),
            done: 0,
        })
    }

    /// Continues from a checkpoint of a trainer with the same input, configuration, seed and stage.
    ///
    /// # Errors
    /// [`FieldError::Checkpoint`] if the counts differ.
    pub fn restore(&mut self, checkpoint: RadianceCheckpoint) -> Result<(), FieldError> {
        let RadianceCheckpoint { fields, motions, done } = checkpoint;
        self.check_fields(&fields)?;
        expect_count("motions", motions.motions.len(), self.config.parts - 1)?;
        expect_count("consistent motions", usize::from(motions.is_consistent()), 1)?;
        for field in &fields {
            expect_count("steps", field.steps as usize, done)?;
        }
        self.engine = RadianceEngine::new(fields);
        self.motions = motions;
        self.done = done;
        Ok(())
    }

    /// Checks number and shape of the fields against the configuration.
    fn check_fields(&self, fields: &Vec<EngineState>) -> Result<(), FieldError> {
        expect_count("fields", fields.len(), self.config.parts)?;
        let own = FieldParams::random_params(&self.config.field, &mut stage_rng(0, "shape", 0));
        for field in fields {
            expect_count("parameters", field.params.parameter_count(), own.parameter_count())?;
            expect_count("first moments", field.first.len(), own.parameter_count())?;
            expect_count("second moments", field.second.len(), own.parameter_count())?;
            expect_count("levels of this layout", usize::from(field.params.levels == own.levels), 1)?;
        }
        Ok(())
    }

    /// One optimiser step of fields and motions.
    pub fn train_step(&mut self) -> RadianceLosses {
        // One random number per step; each ray derives a stream from it.
        let key = stage_rng(self.seed, &self.stage, self.done as u64).next_u64();
        let batch = self.source.step_batch(&self.config, key);
        self.done += 1;
        self.engine.train_step(&batch, &mut self.motions, &self.config, self.done - 1)
    }

    /// Number of steps done.
    pub fn steps_done(&self) -> usize {
        self.done
    }

    /// Total number of steps.
    pub fn total_steps(&self) -> usize {
        self.config.steps
    }

    /// The current fields and motions.
    pub fn trained_model(&self) -> RadianceModel {
        RadianceModel {
            scene: self.scene,
            half_side: self.config.half_side,
            fields: self.engine.field_states().into_iter().map(|s| s.params).collect(),
            motions: self.motions.motions.clone(),
        }
    }

    /// The state, as taken by [`Self::restore`].
    pub fn checkpoint(&self) -> RadianceCheckpoint {
        RadianceCheckpoint {
            fields: self.engine.field_states(),
            motions: self.motions.clone(),
            done: self.done,
        }
    }
}

/// Checks a count against the expected one.
fn expect_count(what: &'static str, found: usize, expected: usize) -> Result<(), FieldError> {
    if found == expected { Ok(()) } else { Err(FieldError::Checkpoint { what, found, expected }) }
}
