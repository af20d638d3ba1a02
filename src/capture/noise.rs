//! How far a depth pixel can be trusted.

use serde::{Deserialize, Serialize};

/// Readings of surfaces seen at a smaller cosine to their normal hold no height, and are not used.
/// chosen: 75 deg; beyond it few stereo cameras read well
pub const GRAZING_COSINE: f64 = 0.25;

/// Depth noise model: one standard deviation is `constant_m + quadratic_per_m * depth^2`, as disparity noise
/// gives. See docs/method.md (2.6).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NoiseConfig {
    /// Noise at zero range, meters.
    pub constant_m: f64,
    /// Growth with the square of the depth, 1/meter.
    pub quadratic_per_m: f64,
    /// A neighbor further away than this many standard deviations (plus the slope of a surface seen at
    /// `grazing_cosine`) marks a depth edge: its pixels are not used.
    pub edge_sigmas: f64,
    /// Surfaces seen at a smaller cosine to their normal are not used.
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
