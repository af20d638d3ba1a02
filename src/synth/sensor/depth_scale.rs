//! Scale error of depth, from the factory calibration of focal length and baseline.

use rand_core::Rng;

use numeric::random;

/// Standard deviation of the scale error over cameras; the data sheet of Intel's D400 family allows 2 % at 2
/// m. chosen: a fifth of it
const SIGMA: f64 = 0.004;

/// Relative depth error of one camera.
pub(super) fn drawn_scale_error(level: f64, rng: &mut impl Rng) -> f64 {
    level * SIGMA * random::standard_normal(rng)
}

#[cfg(test)]
mod tests {
    use super::*;
    use numeric::random::stage_rng;

    #[test]
    fn cameras_differ_by_the_stated_deviation_times_the_level() {
        let draws = |level| (0..4000).map(move |k| drawn_scale_error(level, &mut stage_rng(k, "scale", 0)));
        let rms = |level| (draws(level).map(|s| s * s).sum::<f64>() / 4000.0).sqrt();
        assert!((rms(1.0) / 0.004 - 1.0).abs() < 0.05, "{}", rms(1.0));
        assert!(draws(0.5).zip(draws(1.0)).all(|(half, whole)| half == 0.5 * whole));
    }
}
