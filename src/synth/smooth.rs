//! Smoothing of white noise over an image.

use rayon::prelude::*;

/// White noise smoothed by a Gaussian and scaled to variance one.
pub(super) fn smoothed_noise(white: &[f64], width: usize, height: usize, sigma_px: f64) -> Vec<f64> {
    let reach = (3.0 * sigma_px).ceil() as isize;
    let mut kernel: Vec<f64> =
        (-reach..=reach).map(|d| (-0.5 * (d as f64 / sigma_px).powi(2)).exp()).collect();
    // Division by the root of the sum of squares preserves the variance of white noise.
    let norm = kernel.iter().map(|w| w * w).sum::<f64>().sqrt();
    kernel.iter_mut().for_each(|w| *w /= norm);
    // The Gaussian is separable: rows first, then columns.
    let pixels = (0..white.len()).into_par_iter().with_min_len(width);
    let rows = pixels.clone().map(|i| {
        let columns = (-reach..=reach).map(|d| reflected_index((i % width) as isize + d, width));
        columns.zip(&kernel).map(|(column, w)| w * white[i / width * width + column]).sum::<f64>()
    });
    let rows: Vec<f64> = rows.collect();
    let image = pixels.map(|i| {
        let beside = (-reach..=reach).map(|d| reflected_index((i / width) as isize + d, height));
        beside.zip(&kernel).map(|(row, w)| w * rows[row * width + i % width]).sum::<f64>()
    });
    image.collect()
}

/// Index reflected at the border, which keeps the variance near one.
fn reflected_index(at: isize, n: usize) -> usize {
    (if at < 0 { -at } else { at }).min(2 * (n as isize - 1) - at).unsigned_abs().min(n - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use numeric::random::{self, stage_rng};

    #[test]
    fn smoothed_noise_keeps_its_variance_and_is_correlated() {
        let rng = &mut stage_rng(5, "noise", 0);
        let w = 200;
        let h = 150;
        let white: Vec<f64> = (0..w * h).map(|_| random::standard_normal(rng)).collect();
        let noise = smoothed_noise(&white, w, h, 0.58);
        let n = (w * h) as f64;
        let variance = noise.iter().map(|x| x * x).sum::<f64>() / n;
        let beside = noise.windows(2).map(|p| p[0] * p[1]).sum::<f64>() / n;
        assert!((variance - 1.0).abs() < 0.05, "{variance}");
        // Weights 1 and exp(-1 / (2 * 0.58^2)) = 0.226 beside: 2 * 0.226 / (1 + 2 * 0.226^2) = 0.41.
        assert!((beside - 0.41).abs() < 0.03, "{beside}");
    }
}
