//! Noise model of depth readings.

use serde::{Deserialize, Serialize};

/// Surfaces seen at a smaller cosine between ray and normal have no reliable height and are not used.
/// chosen: 75 deg; beyond it few stereo cameras read well
pub const GRAZING_COSINE: f64 = 0.25;

/// Depth noise model: the standard deviation is `constant_m + quadratic_per_m * depth^2`, as disparity noise
/// implies. See docs/method.md (2.6).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NoiseConfig {
    /// Noise at zero range, meters.
    pub constant_m: f64,
    /// Growth with the square of the depth, 1/meter.
    pub quadratic_per_m: f64,
    /// A depth difference to a neighbor beyond this many standard deviations (plus the slope of a surface at
    /// `grazing_cosine`) marks a depth edge; pixels at edges are not used.
    pub edge_sigmas: f64,
    /// Surfaces at a smaller cosine between ray and normal are not used.
    pub grazing_cosine: f64,
}

impl Default for NoiseConfig {
    fn default() -> Self {
        Self { constant_m: 0.0005, quadratic_per_m: 0.0025, edge_sigmas: 6.0, grazing_cosine: 0.15 }
    }
}

impl NoiseConfig {
    /// Expected standard deviation of a depth reading, meters.
    #[must_use]
    pub fn sigma_m(&self, depth_m: f64) -> f64 {
        self.constant_m + self.quadratic_per_m * depth_m * depth_m
    }
}
