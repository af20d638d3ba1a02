//! Drift of odometry without loop closure: every step between two views has an error.

use nalgebra::Vector3;
use rand_core::Rng;

use geometry::Pose;
use numeric::random;

/// Standard deviation of a step's translation error per axis, in a sweep of [`SWEEP_VIEWS`] views, meters.
/// chosen: 4 mm over a sweep
const STEP_M: f64 = 0.0008;
/// The same for rotation, radians: 0.06 degrees. chosen: a third of a degree over a sweep
const STEP_RAD: f64 = 0.06 * std::f64::consts::PI / 180.0;
/// Number of views for which step errors are stated; with more views the steps err less, with the same total.
/// derived: the default number of views
const SWEEP_VIEWS: f64 = 30.0;

/// The transform from the true to the reported world at each view, for true camera poses.
pub(super) fn drift_walk(level: f64, cameras: &[Pose], rng: &mut impl Rng) -> Vec<Pose> {
    // Variances of independent steps add up.
    let step = level * (SWEEP_VIEWS / cameras.len() as f64).sqrt();
    let mut reported_from_world = Pose::identity();
    let mut at = Vec::with_capacity(cameras.len());
    for (i, camera) in cameras.iter().enumerate() {
        let [shift, turn] = [STEP_M, STEP_RAD]
            .map(|sigma| Vector3::from_fn(|_, _| step * sigma * random::standard_normal(rng)));
        if i > 0 {
            // A step errs in the camera's frame, and the error persists in all later poses.
            reported_from_world = reported_from_world * camera * Pose::new(shift, turn) * camera.inverse();
        }
        at.push(reported_from_world);
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;
    use numeric::random::stage_rng;

    /// Root mean square error of the pose after `steps` of 30 views: meters along an axis, radians about one.
    fn rms(level: f64, steps: usize) -> [f64; 2] {
        let squares = (0..400).fold([0.0; 2], |sum, seed| {
            let last = drift_walk(level, &vec![Pose::identity(); 30], &mut stage_rng(seed, "walk", 0))[steps];
            [
                sum[0] + last.translation.vector.norm_squared() / 3.0,
                sum[1] + last.rotation.angle().powi(2) / 3.0,
            ]
        });
        squares.map(|s| (s / 400.0).sqrt())
    }

    #[test]
    fn the_error_grows_as_the_root_of_the_steps_and_with_the_level() {
        for steps in [1, 4, 16, 29] {
            let grown = (steps as f64).sqrt();
            let [m, rad] = rms(1.0, steps);
            assert!((m / (0.0008 * grown) - 1.0).abs() < 0.08, "{steps} {m}");
            assert!((rad.to_degrees() / (0.06 * grown) - 1.0).abs() < 0.08, "{steps} {rad}");
            let [half_m, half_rad] = rms(0.5, steps);
            assert!((half_m / m - 0.5).abs() < 1e-3 && (half_rad / rad - 0.5).abs() < 1e-3);
        }
        assert_eq!(
            drift_walk(1.0, &[Pose::identity(); 2], &mut stage_rng(0, "walk", 0))[0],
            Pose::identity()
        );
    }

    #[test]
    fn a_turned_step_moves_what_the_camera_sees_from_where_it_stands() {
        // A camera that stands away from the origin keeps its own place in a step that only turns it.
        let cameras = [Pose::translation(3.0, 0.0, 0.0); 2];
        let error = drift_walk(1.0, &cameras, &mut stage_rng(4, "walk", 0))[1];
        let moved = error * cameras[1].translation.vector - cameras[1].translation.vector;
        let origin = (error * nalgebra::Point3::origin()).coords.norm();
        assert!(moved.norm() > 0.0 && origin > 0.0);
        let reported = error * cameras[1];
        let step = cameras[0].inverse() * reported;
        assert!(step.translation.vector.norm() < 5.0 * 0.0008 * 15f64.sqrt() * 3f64.sqrt());
    }
}
