//! Displacement of each state's world from state 0's: a restarted tracker localizes anew.

use rand_core::Rng;

use geometry::Pose;
use numeric::random;

/// Length of the translation, meters. chosen: a jump of millimeters
const SHIFT_M: f64 = 0.0037;
/// Angle of the rotation, radians: 0.3 degrees. chosen: a jump of some tenths
const TURN_RAD: f64 = 0.3 * std::f64::consts::PI / 180.0;

/// Pose of state 0's world in another take's: the full amount, in a random direction and about a random axis
/// through the origin, near the object's base.
pub(super) fn drawn_relocalization(level: f64, rng: &mut impl Rng) -> Pose {
    let shift = random::random_direction(rng).into_inner() * (level * SHIFT_M);
    let turn = random::random_direction(rng).into_inner() * (level * TURN_RAD);
    Pose::new(shift, turn)
}

#[cfg(test)]
mod tests {
    use super::*;
    use numeric::random::stage_rng;

    #[test]
    fn a_world_is_off_by_the_stated_amount() {
        for level in [0.5, 1.0] {
            let off = drawn_relocalization(level, &mut stage_rng(8, "world", 0));
            assert!((off.translation.vector.norm() - 0.0037 * level).abs() < 1e-12);
            assert!((off.rotation.angle().to_degrees() - 0.3 * level).abs() < 1e-9);
        }
    }
}
