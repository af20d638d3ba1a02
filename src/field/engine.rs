//! Interface of the engines that train a field's networks: all take the same parameters and samples, and give
//! the same losses.

use serde::{Deserialize, Serialize};

use super::{EngineError, FieldParams};

/// Target of the network's output `s` at one sample, in truncations. For a network of residuals, `value` is
/// reduced by the known distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SdfTarget {
    /// No supervision.
    Ignore,
    /// Empty space in front of a surface: `weight * |s - value|` where `s < value`; `value` is 1:
    /// docs/method.md (12.4).
    Empty {
        /// Least TSDF of empty space.
        value: f32,
        /// Loss weight.
        weight: f32,
    },
    /// Near an observed surface: `weight * (s - value)^2` ("surface SDF"; `value = (depth - z) /
    /// truncation`).
    Surface {
        /// Signed projective distance, in truncations.
        value: f32,
        /// Loss weight.
        weight: f32,
    },
    /// On a ray past the object: `weight * (s - value)^2` where `s < value`; `value` is `BACKGROUND_TSDF`
    /// ("background free space").
    Background {
        /// Least TSDF of empty space.
        value: f32,
        /// Loss weight.
        weight: f32,
    },
}

/// Least TSDF of samples on a background ray: docs/method.md (12.6).
/// derived: the value of the released program (docs/method.md 12.9)
pub(crate) const BACKGROUND_TSDF: f32 = 0.001;

/// The samples of one optimiser step: `rays` rays of `samples_per_ray` samples each, ray-major.
#[derive(Clone, Debug, Default)]
pub struct SampleBatch {
    /// Number of rays.
    pub rays: usize,
    /// Samples on every ray.
    pub samples_per_ray: usize,
    /// Sample positions in the unit cube `[0, 1]^3` (normalised cube mapped by `(x + 1) / 2`).
    pub points: Vec<[f32; 3]>,
    /// TSDF supervision of every sample.
    pub targets: Vec<SdfTarget>,
    /// Color weight of every sample, normalised along its ray; all 0 on a ray without color loss.
    pub color_weights: Vec<f32>,
    /// Unit view direction of every ray in world axes.
    pub directions: Vec<[f32; 3]>,
    /// Observed color of every ray in `[0, 1]`.
    pub colors: Vec<[f32; 3]>,
    /// Loss weight of every ray's color.
    pub ray_weights: Vec<f32>,
}

/// Loss terms of a step. `total = sdf + color`.
///
/// `sdf` is the mean over all samples (ignored ones count as zeros) of the weighted terms of [`SdfTarget`].
/// `color` is the mean over rays and channels of `ray_weight * (sum_i color_weight_i * sigmoid(c_i) -
/// color)^2`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FieldLosses {
    /// TSDF terms.
    pub sdf: f64,
    /// Color term.
    pub color: f64,
}

/// Parameters and Adam moments, for a checkpoint. Moments are in the order of
/// [`FieldParams::flatten`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EngineState {
    /// Parameters.
    pub params: FieldParams,
    /// First moments.
    pub first: Vec<f32>,
    /// Second moments.
    pub second: Vec<f32>,
    /// Optimiser steps taken.
    pub steps: u64,
}

impl EngineState {
    /// Before the first step: all moments are zero.
    pub fn untrained(params: FieldParams) -> Self {
        let n = params.parameter_count();
        Self { params, first: vec![0.0; n], second: vec![0.0; n], steps: 0 }
    }
}

/// Adam: beta 0.9 and 0.999, epsilon 1e-15, no weight decay (docs/method.md 12.6).
/// derived: the published ones
pub const ADAM_BETAS: (f32, f32) = (0.9, 0.999);
/// Adam's epsilon. chosen: far below the root of any relevant second moment
pub const ADAM_EPSILON: f32 = 1e-15;

/// Trains the parameters of one field.
pub trait FieldEngine: Send {
    /// One optimiser step: forward, backward, Adam.
    fn train_step(&mut self, batch: &SampleBatch, learning_rate: f32) -> FieldLosses;

    /// Losses and their gradient in the order of [`FieldParams::flatten`]; changes nothing.
    fn loss_gradient(&mut self, batch: &SampleBatch) -> (FieldLosses, Vec<f32>);

    /// Everything a checkpoint needs.
    fn training_state(&self) -> EngineState;

    /// Why the engine failed, if it did; its losses are NaN from then on.
    fn failure(&self) -> Option<&EngineError> {
        None
    }
}

impl FieldParams {
    /// All parameters in one vector: the table, then weights and biases of each layer, geometry before color.
    pub fn flatten(&self) -> Vec<f32> {
        let mut all = self.table.clone();
        for layer in self.geometry.iter().chain(&self.color) {
            all.extend_from_slice(&layer.weights);
            all.extend_from_slice(&layer.biases);
        }
        all
    }

    /// Sets all parameters from the order of [`Self::flatten`].
    ///
    /// # Panics
    /// If `values` has the wrong length.
    pub fn assign_values(&mut self, values: &[f32]) {
        let mut rest = values;
        take_values(&mut rest, &mut self.table);
        for layer in self.geometry.iter_mut().chain(&mut self.color) {
            take_values(&mut rest, &mut layer.weights);
            take_values(&mut rest, &mut layer.biases);
        }
        assert!(rest.is_empty(), "{} values too many", rest.len());
    }
}

/// Fills `target` from the front of `rest`.
fn take_values(rest: &mut &[f32], target: &mut [f32]) {
    let (head, tail) = rest.split_at(target.len());
    target.copy_from_slice(head);
    *rest = tail;
}
