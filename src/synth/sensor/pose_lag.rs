//! Delay of poses against the images, from the clocks and delays of two devices.
//!
//! Furgale, Rehder and Siegwart 2013 and Qin and Shen 2018 estimate such delays between camera and inertial
//! sensor, of milliseconds to tens of them. This models the error that remains after correction.

use rand_core::Rng;

use numeric::random;

/// Mean delay over cameras, seconds; each camera has 0.5 to 1.5 times this value.
/// chosen: clocks of two devices differ by milliseconds
const LAG_S: f64 = 0.003;

/// Delay of one camera's reported poses against its images, seconds.
pub(super) fn drawn_lag_s(level: f64, rng: &mut impl Rng) -> f64 {
    level * LAG_S * random::uniform_in(rng, 0.5, 1.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use numeric::random::stage_rng;

    #[test]
    fn lags_lie_about_the_stated_one() {
        let of = |level, seed| drawn_lag_s(level, &mut stage_rng(seed, "lag", 0));
        assert!((0..200).all(|k| (0.0015..0.0045).contains(&of(1.0, k)) && of(2.0, k) == 2.0 * of(1.0, k)));
    }
}
