//! Different light in each state: the lamp has moved and its color has changed.

use nalgebra::{Rotation3, Vector3};
use rand_core::Rng;

use numeric::random;

/// Range of the lamp's rotation about the vertical, radians: 70 to 130 degrees.
/// chosen: from the side to behind
const TURN_RAD: [f64; 2] = [1.22, 2.27];
/// Standard deviation of the log of red and blue relative to green.
/// chosen: the difference of two bulbs
const TINT: f64 = 0.05;

/// Direction and tint of the lamp in another take.
pub(super) fn turned_lamp(
    level: f64,
    lamp: &Vector3<f64>,
    rng: &mut impl Rng,
) -> (Vector3<f64>, Vector3<f64>) {
    let side = if random::is_chosen(rng, 0.5) { 1.0 } else { -1.0 };
    let turn_rad = level * side * random::uniform_in(rng, TURN_RAD[0], TURN_RAD[1]);
    let [red, blue] = [(); 2].map(|()| level * TINT * random::standard_normal(rng));
    let lamp = Rotation3::from_axis_angle(&Vector3::z_axis(), turn_rad) * lamp;
    (lamp, Vector3::new(red, 0.0, blue).map(f64::exp))
}

#[cfg(test)]
mod tests {
    use super::*;
    use numeric::random::stage_rng;

    #[test]
    fn the_lamp_turns_about_the_vertical_by_the_level() {
        let lamp = Vector3::new(0.6, 0.0, 0.8);
        let angle = |level| {
            let (turned, _) = turned_lamp(level, &lamp, &mut stage_rng(5, "lamp", 0));
            assert!((turned.z - 0.8).abs() < 1e-12 && (turned.norm() - 1.0).abs() < 1e-12);
            turned.y.atan2(turned.x)
        };
        assert!((1.22..2.27).contains(&angle(1.0).abs()) && (angle(0.5) - 0.5 * angle(1.0)).abs() < 1e-12);
        assert_eq!(turned_lamp(0.0, &lamp, &mut stage_rng(5, "lamp", 0)), (lamp, Vector3::repeat(1.0)));
    }
}
