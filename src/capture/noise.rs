//! How far a depth pixel can be trusted.

use serde::{Deserialize, Serialize};

use super::RgbdFrame;

/// Depth noise model: one standard deviation is `constant_m + quadratic_per_m * depth^2`, as disparity noise gives.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NoiseConfig {
    /// Noise at zero range, metres.
    pub constant_m: f64,
    /// Growth with the square of the depth, 1/metre.
    pub quadratic_per_m: f64,
    /// A neighbour further away than this many standard deviations (plus the slope of a surface seen at
    /// `grazing_cosine`) marks a depth edge, whose pixels are not used.
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
    /// Expected standard deviation of a depth reading, metres.
    #[must_use]
    pub fn sigma_m(&self, depth_m: f64) -> f64 {
        self.constant_m + self.quadratic_per_m * depth_m * depth_m
    }
}

/// Weight of every pixel's depth in `[0, 1]`: 0 where it is unknown, at a depth edge or seen at a grazing angle, else
/// the cosine between ray and surface normal (from central differences over a 5-pixel window).
#[must_use]
pub fn pixel_weights(frame: &RgbdFrame, noise: &NoiseConfig) -> Vec<f32> {
    let (w, h) = (frame.intrinsics.width, frame.intrinsics.height);
    let depth = |x: usize, y: usize| f64::from(frame.depth_m[y * w + x]);
    let mut weights = vec![0.0; w * h];
    const R: usize = 2;
    for y in R..h.saturating_sub(R) {
        for x in R..w.saturating_sub(R) {
            let d = depth(x, y);
            let around = [depth(x - R, y), depth(x + R, y), depth(x, y - R), depth(x, y + R)];
            if d <= 0.0 || around.iter().any(|&n| n <= 0.0) {
                continue;
            }
            let pixel_m = d * R as f64 / frame.intrinsics.fx;
            let slope = pixel_m * (1.0 - noise.grazing_cosine * noise.grazing_cosine).sqrt() / noise.grazing_cosine;
            if around.iter().any(|n| (n - d).abs() > slope + noise.edge_sigmas * noise.sigma_m(d)) {
                continue;
            }
            let k = &frame.intrinsics;
            let at = |x: usize, y: usize| k.unproject(x as f64, y as f64, depth(x, y));
            let across = at(x + R, y) - at(x - R, y);
            let down = at(x, y + R) - at(x, y - R);
            let normal = across.cross(&down);
            let cosine = normal.dot(&k.ray(x as f64, y as f64)).abs() / (normal.norm() * k.ray(x as f64, y as f64).norm()).max(1e-12);
            if cosine >= noise.grazing_cosine {
                weights[y * w + x] = cosine as f32;
            }
        }
    }
    weights
}
