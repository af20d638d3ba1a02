//! Independent error of every pose.

use nalgebra::Vector3;
use rand_core::Rng;

use geometry::Pose;
use numeric::random;

/// Standard deviation along each axis, meters. chosen: of the order of good trackers
const SHIFT_M: f64 = 0.001;
/// Standard deviation about each axis, radians: 0.05 degrees. chosen: of the order of good trackers
const TURN_RAD: f64 = 0.05 * std::f64::consts::PI / 180.0;

/// Error of a pose in the camera's frame.
pub(super) fn drawn_jitter(level: f64, rng: &mut impl Rng) -> Pose {
    let [shift, turn] = [SHIFT_M, TURN_RAD]
        .map(|sigma| Vector3::from_fn(|_, _| level * sigma * random::standard_normal(rng)));
    Pose::new(shift, turn)
}

#[cfg(test)]
mod tests {
    use super::*;
    use numeric::random::stage_rng;

    #[test]
    fn poses_jitter_by_the_stated_deviations() {
        let rng = &mut stage_rng(1, "jitter", 0);
        let mut m2 = 0.0;
        let mut rad2 = 0.0;
        for _ in 0..2000 {
            let error = drawn_jitter(2.0, rng);
            m2 += error.translation.vector.norm_squared() / 3.0;
            rad2 += error.rotation.angle().powi(2) / 3.0;
        }
        let [m, deg] = [(m2 / 2000.0f64).sqrt(), (rad2 / 2000.0f64).sqrt().to_degrees()];
        assert!((m / 0.002 - 1.0).abs() < 0.05 && (deg / 0.1 - 1.0).abs() < 0.05, "{m} {deg}");
    }
}
