//! Neural object fields: a hash grid and two small networks give TSDF and color at every point
//! (docs/method.md 12).
//!
//! ```
//! use field::{FieldConfig, FieldParams};
//! use numeric::random::stage_rng;
//!
//! let params = FieldParams::random_params(&FieldConfig::default(), &mut stage_rng(0, "field", 0));
//! assert!(params.parameter_count() > 0);
//! ```

mod block;
mod burn_batch;
mod burn_device;
mod burn_engine;
mod burn_hash;
mod burn_model;
#[cfg(test)]
mod burn_tests;
#[cfg(any(test, feature = "gpu"))]
mod burn_trial;
mod config;
mod cpu;
#[cfg(test)]
mod cpu_tests;
mod engine;
mod fused;
#[cfg(feature = "gpu")]
mod gpu_hash;
#[cfg(feature = "gpu")]
mod gpu_kernels;
mod harmonics;
mod learner;
mod matrix;
mod object;
mod occupancy;
mod params;
mod passes;
mod plan;
mod pool;
mod radiance;
#[cfg(test)]
mod reference;
mod sample;
mod simd;
mod trainer;

pub use burn_device::{Adapter, EngineError, adapters};
pub use burn_engine::BurnEngine;
pub use config::{BackgroundLoss, FieldError, TrainConfig};
pub use cpu::{CpuEngine, StepPhase};
pub use engine::{ADAM_BETAS, ADAM_EPSILON, EngineState, FieldEngine, FieldLosses, SampleBatch, SdfTarget};
pub use harmonics::view_coefficients;
pub use object::ObjectField;
pub use occupancy::Occupancy;
pub use params::{
    FEATURES, FieldConfig, FieldParams, GEOMETRY_OUTPUTS, Layer, LevelLayout, VIEW_COEFFICIENTS,
};
pub use radiance::{
    HalfMotion, RadianceCheckpoint, RadianceConfig, RadianceInput, RadianceLosses, RadianceModel,
    RadianceTrainer,
};
pub use simd::InstructionSet;
pub use trainer::{FieldTrainer, TrainInput, TrainerCheckpoint};
