//! The static part's motion between two states, from its own evidence and from all static surroundings. See
//! docs/method.md (5.3).

use nalgebra::Matrix6;

use crate::joints::free_motion::ParentMotion;
use geometry::{Pose, shift_and_turn};
use numeric::statistics::CHI_SQUARE_999;

/// The static part's motion where states were brought into one world frame. `own` is its motion from its own
/// surfaces and matches, `still` the covariance of its rest from the surroundings (a left perturbation,
/// translation 3 and rotation 3, square meters and radians). If they contradict each other, `own` is
/// returned: the object was moved relative to its surroundings.
pub fn static_motion(own: &ParentMotion, still: &Matrix6<f64>) -> ParentMotion {
    // The part's own surfaces left some direction open (see `free_motion`).
    if own.covariance == Matrix6::zeros() {
        return ParentMotion { covariance: *still, ..ParentMotion::static_part() };
    }
    let Some(both) = (own.covariance + still).cholesky().map(|c| c.inverse()) else { return own.clone() };
    let motion = shift_and_turn(&own.state1_from_state0);
    // Six coordinates, in their standard deviations.
    if motion.dot(&(both * motion)) > CHI_SQUARE_999[5] {
        return own.clone();
    }
    let share = still * both;
    let motion = share * motion;
    let covariance = share * own.covariance;
    ParentMotion {
        state1_from_state0: Pose::new(motion.fixed_rows::<3>(0).into(), motion.fixed_rows::<3>(3).into()),
        // The product is symmetric up to rounding only.
        covariance: 0.5 * (covariance + covariance.transpose()),
        drawn: own.drawn.iter().map(|d| share * d).collect(),
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Vector3, Vector6};

    use super::*;
    use geometry::log_so3;

    fn diagonal(sigmas: [f64; 6]) -> Matrix6<f64> {
        Matrix6::from_diagonal(&Vector6::from_row_slice(&sigmas.map(|s| s * s)))
    }

    #[test]
    fn each_direction_is_taken_from_what_knows_it() {
        let motion = Pose::new(Vector3::new(0.001, 0.001, 0.0), Vector3::new(0.0, 0.0, 0.004));
        let own = ParentMotion {
            state1_from_state0: motion,
            covariance: diagonal([0.002, 1e-5, 1e-3, 1e-3, 1e-3, 0.002]),
            drawn: Vec::new(),
        };
        let still = diagonal([1e-5, 0.002, 1e-3, 1e-3, 1e-3, 0.002]);
        let both = static_motion(&own, &still);
        let shift = both.state1_from_state0.translation.vector;
        assert!(shift.x.abs() < 1e-6 && (shift.y - 0.001).abs() < 1e-6, "{shift}");
        assert!((log_so3(&both.state1_from_state0.rotation).z - 0.002).abs() < 1e-9);
        assert!((both.covariance[(5, 5)] - 2e-6).abs() < 1e-12 && both.covariance[(0, 0)] < 1e-10);
    }

    #[test]
    fn what_was_moved_against_its_surroundings_tells_of_itself() {
        let motion = Pose::new(Vector3::new(0.01, 0.0, 0.0), Vector3::zeros());
        let own = ParentMotion {
            state1_from_state0: motion,
            covariance: diagonal([1e-3; 6]),
            ..ParentMotion::static_part()
        };
        assert_eq!(static_motion(&own, &diagonal([1e-3; 6])).state1_from_state0, motion);
        let unseen = ParentMotion { covariance: Matrix6::zeros(), ..own };
        assert_eq!(static_motion(&unseen, &diagonal([1e-3; 6])).state1_from_state0, Pose::identity());
    }
}
