//! Step-by-step training of one field.

use std::sync::Arc;

use nalgebra::Point3;
use rand_core::Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::fused::extended_distances;
use super::pool::RayPool;
use super::sample::Sampler;
use super::{
    CpuEngine, EngineError, EngineState, FieldEngine, FieldError, FieldLosses, FieldParams, ObjectField,
    Occupancy, TrainConfig,
};
use capture::RgbdFrame;
use geometry::{Grid3, SceneBox};
use numeric::random::stage_rng;

/// Initial TSDF of a new field, in truncations (bias of the last geometry layer). Unobserved space stays near
/// it. A residual starts from 0.
/// chosen: behind a surface, where most space is never seen
const INITIAL_TSDF: f32 = -1.0;
/// Factor on the learning rate reached at the last step.
/// derived: the published one
const LEARNING_RATE_DECAY: f64 = 0.1;
/// Share of the steps before outliers are determined.
/// chosen: the surface stands by then, and half of the steps are left
const OUTLIERS_FROM: f64 = 0.5;

/// Creates an engine from a state.
pub(crate) type EngineFactory<'a> = &'a dyn Fn(EngineState) -> Box<dyn FieldEngine>;

/// Input for training a field.
#[derive(Clone, Copy)]
pub struct TrainInput<'a> {
    /// Frames of one state.
    pub frames: &'a [RgbdFrame],
    /// The cube of the object.
    pub scene: SceneBox,
    /// Cells near the surface points of all states.
    pub occupancy: &'a Occupancy,
    /// Fused distances of the same frames, meters, NaN where nothing was observed. Without them, a field
    /// learns the whole distance, from all rays.
    pub fused: Option<&'a Grid3<f32>>,
}

/// Trains one field. Every step depends only on parameters, seed and step number, so that a resumed run ends
/// with exactly the parameters of an uninterrupted one.
pub struct FieldTrainer {
    config: TrainConfig,
    scene: SceneBox,
    occupancy: Occupancy,
    truncation_m: f64,
    pool: RayPool,
    /// Fused distances, meters, if rays supervise only their side.
    sides: Option<Grid3<f32>>,
    /// Base of the network's output, in truncations, if it is a residual.
    base: Option<Arc<Grid3<f32>>>,
    trust: Vec<u8>,
    engine: Box<dyn FieldEngine>,
    seed: u64,
    stage: String,
    done: usize,
}

/// State of an interrupted training, apart from input and configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainerCheckpoint {
    /// Parameters and moments.
    pub engine: EngineState,
    /// Number of steps done.
    pub done: usize,
    /// Trust in every ray of the pool, 0 to 255.
    #[serde(with = "geometry::bytes")]
    pub trust: Vec<u8>,
}

impl FieldTrainer {
    /// Starts with a random field on the CPU engine. `stage` names the random streams, e.g. `field/state0`.
    ///
    /// # Errors
    /// [`FieldError`]: a value out of range, or no usable depth.
    pub fn new(
        input: &TrainInput<'_>,
        config: &TrainConfig,
        seed: u64,
        stage: &str,
    ) -> Result<Self, FieldError> {
        Self::with_engine(input, config, seed, stage, &|state| Box::new(CpuEngine::resume(state)))
    }

    /// As [`Self::new`], with another engine.
    ///
    /// # Errors
    /// [`FieldError`]: a value out of range, or no usable depth.
    pub fn with_engine(
        input: &TrainInput<'_>,
        config: &TrainConfig,
        seed: u64,
        stage: &str,
        factory: EngineFactory<'_>,
    ) -> Result<Self, FieldError> {
        config.validate()?;
        let pool = RayPool::new(input.frames, input.occupancy, config)?;
        let mut params =
            FieldParams::random_params(&config.field, &mut stage_rng(seed, &format!("{stage}/init"), 0));
        let truncation_m = config.derived_truncation_m(&input.scene, pool.median_sigma_m);
        let base =
            input.fused.filter(|_| config.residual).map(|fused| extended_distances(fused, truncation_m));
        // Output 0 is the distance; unobserved space stays near its bias.
        let last = &mut params.geometry[1];
        if base.is_some() {
            // A residual starts as the fused distances themselves.
            last.biases[0] = 0.0;
            last.weights[..last.inputs].fill(0.0);
        } else {
            last.biases[0] = INITIAL_TSDF;
        }
        let engine = factory(EngineState::untrained(params));
        Ok(Self {
            truncation_m,
            sides: input.fused.filter(|_| config.side_test).cloned(),
            base: base.map(Arc::new),
            trust: vec![u8::MAX; pool.surface.len()],
            config: config.clone(),
            scene: input.scene,
            occupancy: input.occupancy.clone(),
            pool,
            engine,
            seed,
            stage: stage.to_owned(),
            done: 0,
        })
    }

    /// Continues from a checkpoint of a trainer with the same input, configuration, seed and stage.
    ///
    /// # Errors
    /// [`FieldError::Checkpoint`] if the counts differ.
    pub fn restore(
        &mut self,
        checkpoint: TrainerCheckpoint,
        factory: EngineFactory<'_>,
    ) -> Result<(), FieldError> {
        let TrainerCheckpoint { engine, done, trust } = checkpoint;
        let parameters = self.engine.training_state().params.parameter_count();
        let checks = [
            ("parameters", engine.params.parameter_count(), parameters),
            ("first moments", engine.first.len(), parameters),
            ("second moments", engine.second.len(), parameters),
            ("rays", trust.len(), self.trust.len()),
            ("steps", engine.steps as usize, done),
        ];
        for (what, found, expected) in checks {
            if found != expected {
                return Err(FieldError::Checkpoint { what, found, expected });
            }
        }
        if engine.params.levels != self.engine.training_state().params.levels {
            return Err(FieldError::Checkpoint {
                what: "levels of another layout:",
                found: engine.params.levels.len(),
                expected: self.config.field.levels,
            });
        }
        self.done = done;
        self.trust = trust;
        self.engine = factory(engine);
        Ok(())
    }

    /// One optimiser step.
    pub fn train_step(&mut self) -> FieldLosses {
        let config = &self.config;
        let outliers_at = (OUTLIERS_FROM * config.steps as f64).round() as usize;
        // Once, with the field at that step: earlier residuals say little about the readings.
        if config.outlier_sigmas > 0.0 && self.done == outliers_at.max(1) {
            self.judge_rays();
        }
        let config = &self.config;
        // One random number per step; each ray derives a stream from it.
        let key = stage_rng(self.seed, &self.stage, self.done as u64).next_u64();
        let sampler = Sampler {
            pool: &self.pool,
            scene: &self.scene,
            occupancy: &self.occupancy,
            config,
            truncation_m: self.truncation_m,
            trust: &self.trust,
            sides: self.sides.as_ref(),
            base: self.base.as_deref(),
        };
        let batch = sampler.step_batch(key);
        // docs/method.md (12.9).
        let rate = config.learning_rate * LEARNING_RATE_DECAY.powf(self.done as f64 / config.steps as f64);
        self.done += 1;
        self.engine.train_step(&batch, rate as f32)
    }

    /// Lowers the trust in rays whose observed point is off the field's surface by much more than the
    /// expected noise: weight `1 / (1 + (r / (k sigma))^2)^2` (Geman and McClure).
    fn judge_rays(&mut self) {
        let field = self.trained_field();
        let pool = &self.pool;
        let noise = self.config.noise;
        let sigmas = self.config.outlier_sigmas;
        // In pieces, to bound the memory.
        for (rays, trust) in pool.surface.chunks(1 << 18).zip(self.trust.chunks_mut(1 << 18)) {
            let points: Vec<Point3<f64>> = rays.par_iter().map(|ray| pool.observed_point(ray)).collect();
            for ((ray, trust), residual_m) in rays.iter().zip(trust).zip(field.signed_distances_m(&points)) {
                let scale = sigmas * noise.sigma_m(f64::from(ray.depth_m));
                // docs/method.md (12.7).
                let ratio = f64::from(residual_m) / scale;
                *trust = (255.0 / (1.0 + ratio * ratio).powi(2)).round() as u8;
            }
        }
    }

    /// Number of steps done.
    pub fn steps_done(&self) -> usize {
        self.done
    }

    /// Total number of steps.
    pub fn total_steps(&self) -> usize {
        self.config.steps
    }

    /// Why the engine failed, if it did. Training can continue from an earlier checkpoint on another engine.
    pub fn failure(&self) -> Option<&EngineError> {
        self.engine.failure()
    }

    /// The truncation, meters.
    pub fn truncation_m(&self) -> f64 {
        self.truncation_m
    }

    /// The field as trained so far.
    pub fn trained_field(&self) -> ObjectField {
        ObjectField {
            params: self.engine.training_state().params,
            scene: self.scene,
            truncation_m: self.truncation_m,
            base: self.base.clone(),
        }
    }

    /// The state, as taken by [`Self::restore`].
    pub fn checkpoint(&self) -> TrainerCheckpoint {
        TrainerCheckpoint { engine: self.engine.training_state(), done: self.done, trust: self.trust.clone() }
    }
}
