//! Density and color fields of an object's parts, rendered as one volume and trained from images of two
//! states jointly with the parts' motions: PARIS (Liu, Mahdavi-Amiri and Savva 2023), PARIS* with depth, and
//! PARIS*-m for many parts (both Weng et al. 2024, supplement). Implemented from the equations of these
//! papers.
//!
//! Part 0 is static, with its field in the world frame. Every other part is mobile, with its field in a
//! canonical frame midway between the states. Fields have the layout of object fields: the geometry network's
//! first output `o` gives the density `exp(o - 1)` per normalised unit, and the color network takes 15
//! features and 16 harmonics of the view direction (published: all 16 outputs, no biases).

mod block;
mod columns;
mod composite;
mod config;
mod engine;
#[cfg(test)]
mod engine_tests;
mod half_motion;
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
mod typed_motion;

pub use config::RadianceConfig;
pub use half_motion::HalfMotion;
pub use loss::RadianceLosses;
pub use model::RadianceModel;
pub use trainer::{RadianceCheckpoint, RadianceInput, RadianceTrainer};
