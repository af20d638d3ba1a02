//! Smooth depth error fixed to the pixels: the remainder of lens distortion and rectification after
//! calibration.
//!
//! Basso, Menegatti and Pretto 2018 and Teichman, Miller and Thrun 2013 estimate such fields for consumer
//! depth cameras: multiplicative, smooth over the image and constant for a camera. Here one field of relative
//! errors holds for all ranges; theirs depends on range.

use rand_core::Rng;

use crate::smooth::smoothed_noise;
use numeric::random;

/// Root mean square over the pixels, share of the range.
/// chosen: of the order that calibrations leave (docs/method.md 2.11)
const RMS: f64 = 0.004;
/// Distance at which the correlation is 1/e, share of the image width (90 of 640 pixels).
/// chosen: as docs/method.md 2.11 expects
const CORRELATION_SHARE: f64 = 90.0 / 640.0;

/// Relative depth error of each pixel of a camera, row-major. Its mean is zero, since the mean belongs to the
/// scale error.
pub(super) fn warp_field(level: f64, width: usize, height: usize, rng: &mut impl Rng) -> Vec<f64> {
    let white: Vec<f64> = (0..width * height).map(|_| random::standard_normal(rng)).collect();
    // A Gaussian of deviation s gives the correlation exp(-d^2 / 4 s^2).
    let rough = smoothed_noise(&white, width, height, 0.5 * CORRELATION_SHARE * width as f64);
    let n = rough.len() as f64;
    let mean = rough.iter().sum::<f64>() / n;
    let rms = (rough.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / n).sqrt();
    rough.iter().map(|r| level * RMS * (r - mean) / rms).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use numeric::random::stage_rng;

    #[test]
    fn the_field_has_its_size_and_its_correlation() {
        let w = 320;
        let h = 240;
        let mut at_lag = 0.0;
        let mut squares = 0.0;
        for seed in 0..30 {
            let field = warp_field(1.0, w, h, &mut stage_rng(seed, "warp", 0));
            let mean = field.iter().sum::<f64>() / field.len() as f64;
            let rms = (field.iter().map(|f| f * f).sum::<f64>() / field.len() as f64).sqrt();
            assert!((rms / 0.004 - 1.0).abs() < 1e-9 && mean.abs() < 1e-12, "{rms} {mean}");
            // Half of 90 pixels at half of the width.
            for y in (0..h).step_by(10) {
                for x in 0..w - 45 {
                    at_lag += field[y * w + x] * field[y * w + x + 45];
                    squares += field[y * w + x].powi(2);
                }
            }
            assert!(field.windows(2).filter(|p| (p[1] - p[0]).abs() > 0.0006).count() < 2 * h);
        }
        // The mean that was taken off lowers it.
        let correlation = at_lag / squares;
        assert!((0.2..0.45).contains(&correlation), "{correlation}");
    }

    #[test]
    fn the_level_scales_it() {
        let of = |level| warp_field(level, 96, 72, &mut stage_rng(3, "warp", 0));
        assert!(of(0.5).iter().zip(of(1.0)).all(|(half, whole)| (half - 0.5 * whole).abs() < 1e-15));
    }
}
