//! Changes of exposure and white balance between views, as by automatic control.

use nalgebra::Vector3;
use rand_core::Rng;

use numeric::random;

/// Standard deviation of the log exposure. derived: as in `surface::lighting`
const EXPOSURE: f64 = 0.15;
/// Standard deviation of the log gain of red and blue relative to green.
/// chosen: hardly visible
const WHITE_BALANCE: f64 = 0.03;

/// Factor on linear red, green and blue for a view.
pub(super) fn drawn_gain(level: f64, rng: &mut impl Rng) -> Vector3<f64> {
    let [exposure, red, blue] =
        [EXPOSURE, WHITE_BALANCE, WHITE_BALANCE].map(|s| level * s * random::standard_normal(rng));
    // Errors are logarithmic, so that gains stay positive at any level.
    Vector3::new(exposure + red, exposure, exposure + blue).map(f64::exp)
}

#[cfg(test)]
mod tests {
    use super::*;
    use numeric::random::stage_rng;

    #[test]
    fn gains_vary_by_the_stated_deviations() {
        let rng = &mut stage_rng(1, "gain", 0);
        let mut green = 0.0;
        let mut red = 0.0;
        for _ in 0..4000 {
            let log = drawn_gain(0.5, rng).map(f64::ln);
            green += log.y.powi(2) / 4000.0;
            red += (log.x - log.y).powi(2) / 4000.0;
        }
        assert!((green.sqrt() / 0.075 - 1.0).abs() < 0.05 && (red.sqrt() / 0.015 - 1.0).abs() < 0.05);
        assert_eq!(drawn_gain(0.0, rng), Vector3::repeat(1.0));
    }
}
