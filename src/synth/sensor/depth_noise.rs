//! Correlated disparity noise: stereo matches windows, so neighboring pixels share errors.

use rand_core::Rng;

use crate::smooth::smoothed_noise;
use numeric::random;

/// Standard deviation, pixels: with the 0.073 pixels of the camera model it gives the 0.08 that Intel's guide
/// to tuning D400 cameras names for a good textured surface.
/// derived: the root of the difference of these squares
const SIGMA_PX: f64 = 0.033;
/// Distance at which the correlation is 1/e, pixels. chosen: of the order of a matching window
const CORRELATION_PX: f64 = 3.0;

/// Disparity error of each pixel of a frame, pixels.
pub(super) fn disparity_noise(level: f64, width: usize, height: usize, rng: &mut impl Rng) -> Vec<f64> {
    let white: Vec<f64> = (0..width * height).map(|_| random::standard_normal(rng)).collect();
    // A Gaussian of deviation s gives the correlation exp(-d^2 / 4 s^2).
    let mut noise = smoothed_noise(&white, width, height, 0.5 * CORRELATION_PX);
    noise.iter_mut().for_each(|n| *n *= level * SIGMA_PX);
    noise
}

#[cfg(test)]
mod tests {
    use super::*;
    use numeric::random::stage_rng;

    #[test]
    fn noise_has_its_size_and_is_shared_by_neighbors() {
        let w = 320;
        let h = 240;
        let noise = disparity_noise(1.0, w, h, &mut stage_rng(1, "noise", 0));
        let n = noise.len() as f64;
        let variance = noise.iter().map(|x| x * x).sum::<f64>() / n;
        assert!((variance.sqrt() / 0.033 - 1.0).abs() < 0.03, "{variance}");
        let at = |d: usize| noise.iter().zip(&noise[d..]).map(|(a, b)| a * b).sum::<f64>() / n / variance;
        assert!((at(3) - (-1f64).exp()).abs() < 0.05 && at(12).abs() < 0.05, "{} {}", at(3), at(12));
        let twice = disparity_noise(2.0, w, h, &mut stage_rng(1, "noise", 0));
        assert!(noise.iter().zip(&twice).all(|(a, b)| (2.0 * a - b).abs() < 1e-15));
    }
}
