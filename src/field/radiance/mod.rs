//! Density and color fields of the parts of an object, rendered as one volume and trained from images of two
//! states together with the parts' motions: PARIS (Liu, Mahdavi-Amiri and Savva 2023), PARIS* and PARIS*-m
//! (Weng et al. 2024, supplement), as docs/method.md of the shared notes (7.1 to 7.3) reads their equations.

mod block;
mod columns;
mod composite;
mod config;
mod engine;
#[cfg(test)]
mod engine_tests;
mod half_motion;
mod joint;
mod loss;
mod model;
mod motion_adam;
mod pieces;
mod position;
mod ray_batch;
#[cfg(test)]
mod recovery_tests;
#[cfg(test)]
mod reference;
mod trainer;

pub use config::RadianceConfig;
pub use half_motion::HalfMotion;
pub use joint::{JointEstimate, MotionKind};
pub use loss::RadianceLosses;
pub use model::RadianceModel;
pub use trainer::{RadianceCheckpoint, RadianceInput, RadianceTrainer};
