//! Truncation distance and least weight of a fusion, from the noise of the readings.

use capture::{NoiseConfig, RgbdFrame, median_over_object};
use geometry::SceneBox;
use surface::SurfaceConfig;

/// A node counts as observed from the weight of this many frontal readings at the median depth.
/// chosen: one reading at a slant
const MIN_READINGS: f64 = 0.2;

/// Scale and noise of one state's recording.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Band {
    /// Truncation distance, meters.
    pub truncation_m: f64,
    /// Least observation weight of a node.
    pub min_weight: f32,
}

impl Band {
    /// From the median depth of the object's pixels over all states.
    pub(crate) fn of(
        states: &[&[RgbdFrame]],
        scene: &SceneBox,
        noise: &NoiseConfig,
        config: &SurfaceConfig,
    ) -> Self {
        let all = || states.iter().copied().flatten();
        let sigma_m = median_over_object(all(), |f, i| f.sigma_m(i, noise)).unwrap_or(1.0);
        let depth_m = median_over_object(all(), |f, i| f64::from(f.depth_m[i])).unwrap_or(1.0);
        let one_reading_m = noise.sigma_m(depth_m);
        let asked_m = config.truncation_normalized.map(|t| t / scene.scale);
        Self {
            // docs/method.md (3.1).
            truncation_m: asked_m.unwrap_or_else(|| (0.02 * scene.extent_m()).max(4.0 * sigma_m)),
            // A reading's weight is relative to one at 1 m (3.2), and the object is farther or nearer.
            min_weight: (MIN_READINGS * (noise.sigma_m(1.0) / one_reading_m).powi(2)) as f32,
        }
    }
}
