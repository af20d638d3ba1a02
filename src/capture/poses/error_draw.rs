//! Random draws of the errors that remain in corrected poses and depth.
//!
//! Such errors are common to all readings of a frame. Every result is computed for each draw, and the spread
//! over the draws gives its covariance (an ensemble: Evensen 2003). See docs/method.md 2.12.

use nalgebra::{DMatrix, DVector, Point3, Vector3, Vector6};
use rand_core::Rng;
use serde::{Deserialize, Serialize};

use super::{RgbdFrame, depth_warp::DepthWarp};
use geometry::Pose;
use numeric::random::{stage_rng, standard_normal};

/// Number of draws; a standard deviation estimated from them has a relative error of an eighth.
///
/// derived: one over the root of twice their number
const DRAWS: usize = 32;

/// One draw of the remaining errors of poses and depth.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ErrorDraw {
    /// By state and frame: a motion in the camera's frame, translation, meters, and rotation, radians.
    pub poses: Vec<Vec<Vector6<f64>>>,
    /// Error of depth, where it was corrected.
    pub warp: Option<DepthWarp>,
}

impl ErrorDraw {
    /// Whether the draw has an error for each of a state's `frames` frames.
    #[must_use]
    pub fn covers(&self, state: usize, frames: usize) -> bool {
        self.poses.get(state).is_some_and(|poses| poses.len() == frames)
    }

    /// World displacement by the errors of pose and depth, meters, of a point in the camera's frame, seen at
    /// a pixel.
    #[must_use]
    pub fn displacement_m(
        &self,
        [state, frame]: [usize; 2],
        world_from_camera: &Pose,
        point: &Vector3<f64>,
        pixel: [f64; 2],
    ) -> Vector3<f64> {
        let share = self.warp.as_ref().map_or(0.0, |warp| warp.relative_error_at(pixel));
        world_from_camera.rotation * (self.moved_by_pose([state, frame], point) + share * point)
    }

    /// Displacement by the pose error alone, in the camera's frame, meters.
    pub(super) fn moved_by_pose(&self, [state, frame]: [usize; 2], point: &Vector3<f64>) -> Vector3<f64> {
        let error = &self.poses[state][frame];
        error.fixed_rows::<3>(0) + error.fixed_rows::<3>(3).cross(point)
    }

    /// Mean motion of a world point, meters, and mean rotation, radians, over the frames of state 0.
    pub(super) fn mean_motion_of_first_state(
        &self,
        frames: &[RgbdFrame],
        point: &Point3<f64>,
    ) -> [Vector3<f64>; 2] {
        let mut sum = [Vector3::zeros(); 2];
        for (f, frame) in frames.iter().enumerate() {
            let pose = &frame.world_from_camera;
            let seen = pose.inverse_transform_point(point).coords;
            let turned = pose.rotation * self.poses[0][f].fixed_rows::<3>(3).into_owned();
            sum = [sum[0] + pose.rotation * self.moved_by_pose([0, f], &seen), sum[1] + turned];
        }
        sum.map(|v| v / frames.len() as f64)
    }
}

/// One draw of the poses of several states and of their sensor.
#[derive(Clone, Debug)]
pub(super) struct Drawn {
    /// Pose errors, by state and frame.
    pub poses: Vec<Vec<Vector6<f64>>>,
    /// Errors of the sensor's parameters.
    pub sensor: DVector<f64>,
}

/// Draws of the errors of poses and sensor. Each state gives the covariance of its poses for a known sensor
/// and their derivative by the sensor's errors; `None` where a covariance is not positive. See
/// docs/method.md (2.24).
pub(super) fn drawn_errors(states: &[[DMatrix<f64>; 2]], sensor: &DMatrix<f64>) -> Option<Vec<Drawn>> {
    let rng = &mut stage_rng(0, "errors of poses and depth", 0);
    let roots: Vec<DMatrix<f64>> =
        states.iter().map(|[own, _]| covariance_root(own)).collect::<Option<_>>()?;
    let root_of_sensor = covariance_root(sensor)?;
    let mut draws = Vec::with_capacity(DRAWS);
    for _ in 0..DRAWS {
        let sensor = normal_draw(&root_of_sensor, rng);
        let mut poses = Vec::with_capacity(states.len());
        for ([_, follow], root) in states.iter().zip(&roots) {
            let error = normal_draw(root, rng) - follow * &sensor;
            poses.push(error.as_slice().chunks_exact(6).map(Vector6::from_column_slice).collect());
        }
        draws.push(Drawn { poses, sensor });
    }
    Some(draws)
}

/// Lower Cholesky factor of a covariance; it may be empty.
fn covariance_root(covariance: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    match covariance.nrows() {
        0 => Some(DMatrix::zeros(0, 0)),
        _ => covariance.clone().cholesky().map(|c| c.l()),
    }
}

/// A draw from a zero-mean normal distribution, from the root of its covariance.
fn normal_draw(root: &DMatrix<f64>, rng: &mut impl Rng) -> DVector<f64> {
    root * DVector::from_fn(root.nrows(), |_, _| standard_normal(rng))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_goes_with_its_camera_and_its_depth() {
        let error = Vector6::new(0.001, -0.002, 0.0, 0.0, 0.003, 0.001);
        let k = geometry::Intrinsics { width: 64, height: 48, fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0 };
        let mut warp = DepthWarp::without_errors(&k);
        warp.values.iter_mut().for_each(|v| *v = 0.002);
        let draw = ErrorDraw { poses: vec![vec![error]], warp: Some(warp) };
        let camera = Pose::new(Vector3::x(), Vector3::y());
        let point = Vector3::new(0.1, -0.2, 1.5);
        let wrong = draw.displacement_m([0, 0], &camera, &point, [10.0, 20.0]);
        let moved = camera * Pose::new(error.fixed_rows::<3>(0).into(), error.fixed_rows::<3>(3).into());
        let there = moved * nalgebra::Point3::from(1.002 * point);
        let expected = there - camera * nalgebra::Point3::from(point);
        assert!((wrong - expected).norm() < 2e-5, "{wrong} {expected}");
    }

    #[test]
    fn draws_have_the_covariance_that_they_are_drawn_from() {
        let follow = DMatrix::from_fn(6, 1, |r, _| r as f64);
        let own = DMatrix::from_diagonal_element(6, 6, 4.0);
        let all = drawn_errors(&[[own, follow]], &DMatrix::from_element(1, 1, 9.0)).unwrap();
        let variance = |k: usize| all.iter().map(|d| d.poses[0][0][k].powi(2)).sum::<f64>() / DRAWS as f64;
        for (k, expected) in [(0, 4.0), (3, 4.0 + 81.0), (5, 4.0 + 225.0)] {
            assert!((variance(k) / expected).ln().abs() < 0.7, "{k}: {} {expected}", variance(k));
        }
    }
}
