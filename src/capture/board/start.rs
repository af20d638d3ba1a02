//! Start values for the pose of a plane from points of it.

use nalgebra::{Matrix3, Point2, SMatrix, UnitQuaternion, Vector3};

use geometry::{Intrinsics, Pose};

/// Camera pose by points of the plane z = 0 and their homography (direct linear transformation: Hartley and
/// Zisserman 2004, section 4.1); `None` where the points do not determine it.
pub(super) fn pose_by_homography(
    intrinsics: &Intrinsics,
    points: &[(Point2<f64>, Point2<f64>)],
) -> Option<Pose> {
    if points.len() < 4 {
        return None;
    }
    // Scaled by the extent of the points, for good conditioning.
    let n = points.len() as f64;
    let middle = points.iter().map(|(p, _)| p.coords).sum::<nalgebra::Vector2<f64>>() / n;
    let size = points.iter().map(|(p, _)| (p.coords - middle).norm()).sum::<f64>() / n;
    let mut squares = SMatrix::<f64, 9, 9>::zeros();
    for (p, pixel) in points {
        let on_plane = (p.coords - middle) / size.max(1e-12);
        let ray = intrinsics.ray_at(pixel.x, pixel.y);
        for (k, value) in [(0, ray.x), (1, ray.y)] {
            let mut row = SMatrix::<f64, 9, 1>::zeros();
            for (j, v) in [on_plane.x, on_plane.y, 1.0].into_iter().enumerate() {
                row[3 * k + j] = v;
                row[6 + j] = -value * v;
            }
            squares += row * row.transpose();
        }
    }
    let eigen = squares.symmetric_eigen();
    let h = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    let column = |j: usize| Vector3::new(h[j], h[3 + j], h[6 + j]);
    let first = column(0);
    let second = column(1);
    let mut at = column(2);
    let mut scale = 2.0 / (first.norm() + second.norm());
    // The points lie in front of the camera.
    if at.z < 0.0 {
        scale = -scale;
    }
    at *= scale;
    let x = first * scale;
    let y = second * scale;
    let svd = Matrix3::from_columns(&[x, y, x.cross(&y)]).svd(true, true);
    let rotation = svd.u? * svd.v_t?;
    if !(rotation.determinant() > 0.0) || !at.iter().all(|v| v.is_finite()) {
        return None;
    }
    let rotation = UnitQuaternion::from_matrix(&rotation);
    let origin = at * size - rotation * Vector3::new(middle.x, middle.y, 0.0);
    Some(Pose::from_parts(origin.into(), rotation))
}

/// The second pose under which a small plane looks nearly the same: its normal is reflected at the viewing
/// ray (Schweighofer and Pinz 2006).
pub(super) fn turned_over(camera_from_board: &Pose) -> Option<Pose> {
    let ray = camera_from_board.translation.vector.try_normalize(1e-12)?;
    let normal = camera_from_board.rotation * Vector3::z();
    let axis = nalgebra::Unit::try_new(normal.cross(&-ray), 1e-6)?;
    let turn = UnitQuaternion::from_axis_angle(&axis, 2.0 * normal.angle(&-ray));
    Some(Pose::from_parts(camera_from_board.translation, turn * camera_from_board.rotation))
}
