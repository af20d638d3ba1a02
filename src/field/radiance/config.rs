//! Settings for training the radiance fields of an object's parts.

use serde::{Deserialize, Serialize};

use super::super::config::{check_shape, ensure_within};
use super::super::simd::COLUMN_ALIGN;
use super::super::{FieldConfig, FieldError};

/// Number of steps of the published schedules (Liu, Mahdavi-Amiri and Savva 2023).
/// derived: the published one
const PUBLISHED_STEPS: f64 = 30_000.0;
/// Published steps that halve the fields' learning rate. derived: the published ones
const FIELD_STEPS: [f64; 5] = [10_000.0, 15_000.0, 18_000.0, 20_000.0, 25_000.0];
/// Published steps that multiply the motions' learning rate by 0.33. derived: the published ones
const MOTION_STEPS: [f64; 6] = [5_000.0, 10_000.0, 15_000.0, 18_000.0, 20_000.0, 25_000.0];

/// Rendering weight below which a sample has no color.
/// chosen: 96 samples of a ray then miss at most a hundredth of its color
const COLOR_THRESHOLD: f64 = 1e-4;

/// Shape, samples, schedule and loss weights of PARIS, PARIS* and PARIS*-m.
///
/// The defaults suit a CPU and are smaller than the published ones: hash grids of 16 levels up to 4096 nodes
/// per side, 256 rays per state, later adapted to about 262,144 samples of fixed length per step, and 30,000
/// steps. Here the numbers of rays and of samples per ray are fixed, and the samples divide the ray's path
/// through the scene cube.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RadianceConfig {
    /// Hash grid and networks of every part.
    pub field: FieldConfig,
    /// Number of parts: one static, the others mobile. This is not a setting; `run.parts` and
    /// [`Self::many_parts`] determine it.
    #[serde(skip, default = "two")]
    pub parts: usize,
    /// Whether all requested parts are used (PARIS*-m), or two (PARIS, PARIS*).
    pub many_parts: bool,
    /// Optimiser steps; the published schedules are scaled to this number.
    pub steps: usize,
    /// Rays per step and state.
    pub rays: usize,
    /// Samples per ray, a multiple of 16.
    pub samples: usize,
    /// Half the side of every field's cube, in normalised units (the object spans 0.9; published: 1.5). It is
    /// larger than [`Self::ray_half_side`], as a mobile part midway between its states may extend beyond the
    /// cube of both.
    pub half_side: f64,
    /// Half the side of the cube in which rays are sampled, normalised units (published: 1.5 as well).
    pub ray_half_side: f64,
    /// Learning rate of the fields for the published number of steps (published: 0.002).
    pub learning_rate: f64,
    /// Factor on the published learning rates of the motions.
    pub motion_rate_scale: f64,
    /// Weight of the squared error of the rendered distance, normalised units (PARIS*: 0.01; PARIS: 0).
    pub depth_weight: f64,
    /// Weight of the entropy of the parts' shares of a ray's opacity (published code: 0).
    pub part_entropy_weight: f64,
    /// Rendering weight below which a sample has no color and counts as the white background. The color
    /// network, the largest cost, is skipped there; 0 skips it only where the weight is 0. This is not a
    /// setting.
    #[serde(skip)]
    pub color_threshold: f64,
    /// Nodes per side of the grid for meshing a part (published: 256).
    pub mesh_nodes: usize,
}

/// Least number of parts.
fn two() -> usize {
    2
}

impl Default for RadianceConfig {
    fn default() -> Self {
        Self {
            field: FieldConfig {
                levels: 12,
                base_resolution: 16,
                finest_resolution: 512,
                log2_table_size: 17,
                hidden: 64,
            },
            parts: two(),
            many_parts: false,
            steps: 3000,
            rays: 256,
            samples: 96,
            half_side: 1.5,
            ray_half_side: 1.0,
            learning_rate: 0.002,
            motion_rate_scale: 1.0,
            depth_weight: 0.01,
            part_entropy_weight: 0.0,
            color_threshold: COLOR_THRESHOLD,
            mesh_nodes: 256,
        }
    }
}

impl RadianceConfig {
    /// Checks that all values are in their ranges.
    ///
    /// # Errors
    /// [`FieldError::Config`] with the key and its range.
    pub fn validate(&self) -> Result<(), FieldError> {
        check_shape(&self.field)?;
        ensure_within("parts", self.parts as f64, 2.0, 64.0)?;
        ensure_within("steps", self.steps as f64, 1.0, 1e7)?;
        ensure_within("rays", self.rays as f64, 1.0, 1e5)?;
        ensure_within("samples", self.samples as f64, 16.0, 4096.0)?;
        // Rays start at whole vectors of the kernels.
        ensure_within("samples modulo 16", (self.samples % COLUMN_ALIGN) as f64, 0.0, 0.0)?;
        ensure_within("half_side", self.half_side, 0.1, 100.0)?;
        ensure_within("ray_half_side", self.ray_half_side, 0.1, self.half_side)?;
        ensure_within("learning_rate", self.learning_rate, 1e-8, 1.0)?;
        ensure_within("motion_rate_scale", self.motion_rate_scale, 0.0, 1e3)?;
        ensure_within("depth_weight", self.depth_weight, 0.0, 1e6)?;
        ensure_within("mesh_nodes", self.mesh_nodes as f64, 16.0, 1024.0)?;
        ensure_within("part_entropy_weight", self.part_entropy_weight, 0.0, 1e6)
    }

    /// Learning rate of the fields at a step, counted from 0; halved at 1/3, 1/2, 3/5, 2/3 and 5/6 of the
    /// steps.
    pub(super) fn field_rate(&self, step: usize) -> f64 {
        self.rate_factor() * self.learning_rate * 0.5f64.powi(self.passed_milestones(&FIELD_STEPS, step))
    }

    /// Factor on the motions' learning rates at a step, counted from 0.
    pub(super) fn motion_rate(&self, step: usize) -> f64 {
        self.rate_factor()
            * self.motion_rate_scale
            * 0.33f64.powi(self.passed_milestones(&MOTION_STEPS, step))
    }

    /// Factor on all published rates for a number of steps other than the published one.
    ///
    /// derived: with noise as gradient, Adam steps by plus or minus the rate, and n steps move sqrt(n) times
    /// as far; measured: without it, a laptop's hinge is found at half its angle
    fn rate_factor(&self) -> f64 {
        (PUBLISHED_STEPS / self.steps as f64).sqrt()
    }

    /// Number of published milestones passed at a step, scaled to the configured number of steps.
    fn passed_milestones(&self, milestones: &[f64], step: usize) -> i32 {
        let published = step as f64 / self.steps as f64 * PUBLISHED_STEPS;
        milestones.iter().filter(|&&m| published >= m).count() as i32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_fall_where_the_published_ones_do() {
        let c = RadianceConfig { steps: 300, ..RadianceConfig::default() };
        // A hundredth of the steps, each ten times as long.
        assert_eq!((c.field_rate(0), c.field_rate(99)), (0.02, 0.02));
        assert_eq!((c.field_rate(100), c.field_rate(299)), (0.01, 0.02 / 32.0));
        assert_eq!((c.motion_rate(49), c.motion_rate(50)), (10.0, 0.33 * 10.0));
        assert!((c.motion_rate(299) - 10.0 * 0.33f64.powi(6)).abs() < 1e-12);
        let published = RadianceConfig { steps: 30_000, ..RadianceConfig::default() };
        assert_eq!((published.field_rate(0), published.motion_rate(0)), (0.002, 1.0));
    }

    #[test]
    fn values_out_of_range_are_refused() {
        assert!(RadianceConfig::default().validate().is_ok());
        let bad = RadianceConfig { samples: 40, ..RadianceConfig::default() };
        assert!(matches!(bad.validate(), Err(FieldError::Config { key: "samples modulo 16", .. })));
        let bad = RadianceConfig { ray_half_side: 2.0, ..RadianceConfig::default() };
        assert!(matches!(bad.validate(), Err(FieldError::Config { key: "ray_half_side", .. })));
    }
}
