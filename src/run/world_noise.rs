//! What is not known of the place of the world itself, because the poses of all cameras have errors.

use nalgebra::{Matrix3, Matrix6, Point3, SMatrix, Vector3};

use crate::{
    capture::{PoseNoise, RgbdFrame},
    geometry::skew,
};

/// Covariance of a joint's direction, point and motion by independent errors of the camera poses of state 0:
/// their mean turns and moves all that is seen as one, whatever the frames agree on.
/// See docs/method.md (8.13).
pub(super) fn world_covariance(
    frames: &[RgbdFrame],
    noise: &PoseNoise,
    axis: &Vector3<f64>,
    point: &Point3<f64>,
) -> SMatrix<f64, 7, 7> {
    // One camera moves the mean by its share.
    let share = 1.0 / frames.len().max(1) as f64;
    let mut errors = Matrix6::zeros();
    for k in 0..3 {
        errors[(k, k)] = (share * noise.translation_m).powi(2);
        errors[(3 + k, 3 + k)] = (share * noise.rotation_rad).powi(2);
    }
    let of_camera = |f: &RgbdFrame| {
        let lever = point.coords - f.world_from_camera.translation.vector;
        // A_i of (8.13). Rows: direction, point, motion; columns: translation, turn. The
        // motion stays: all states move with the world.
        let mut by = SMatrix::<f64, 7, 6>::zeros();
        by.fixed_view_mut::<3, 3>(0, 3).copy_from(&-skew(axis));
        by.fixed_view_mut::<3, 3>(3, 0).copy_from(&Matrix3::identity());
        by.fixed_view_mut::<3, 3>(3, 3).copy_from(&-skew(&lever));
        by * errors * by.transpose()
    };
    frames.iter().map(of_camera).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Intrinsics, Pose};

    #[test]
    fn the_mean_of_many_poses_moves_and_turns_an_axis() {
        let frame = |x: f64| RgbdFrame {
            id: String::new(),
            stamp_nanos: 0,
            intrinsics: Intrinsics { width: 1, height: 1, fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 },
            world_from_camera: Pose::translation(x, 0.0, 0.0),
            rgb: vec![[0; 3]],
            depth_m: vec![0.0],
            mask: None,
            readings: Vec::new(),
        };
        let frames = [2.0, -2.0, 2.0, -2.0].map(frame);
        let noise = PoseNoise { translation_m: 0.004, rotation_rad: 0.01 };
        let c = world_covariance(&frames, &noise, &Vector3::z(), &Point3::origin());
        // Half of one pose's error for four: the axis tilts about x and y, not about itself.
        let near = |at: usize, sigma: f64| {
            assert!((c[(at, at)].sqrt() - sigma).abs() < 1e-9, "{at} {}", c[(at, at)].sqrt())
        };
        [
            (0, 0.005),
            (1, 0.005),
            (2, 0.0),
            (3, 0.002),
            (4, 0.002f64.hypot(0.01)),
            (5, 0.002f64.hypot(0.01)),
            (6, 0.0),
        ]
        .into_iter()
        .for_each(|(at, sigma)| near(at, sigma));
    }
}
