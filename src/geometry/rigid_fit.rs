//! The best rigid motion from points to points.

use nalgebra::{Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::Pose;

/// Minimizes `sum w |T a - b|^2` over rigid motions T (Kabsch 1976; reflections excluded as by Umeyama 1991).
/// `None` with fewer than three pairs of positive weight or where one of the point sets has no extent in two
/// directions. See docs/method.md (6.1).
pub fn rigid_fit(pairs: impl Iterator<Item = (Point3<f64>, Point3<f64>, f64)> + Clone) -> Option<Pose> {
    let mut total = 0.0;
    let mut mean_a = Vector3::zeros();
    let mut mean_b = Vector3::zeros();
    let mut count = 0;
    for (a, b, w) in pairs.clone().filter(|p| p.2 > 0.0) {
        total += w;
        mean_a += a.coords * w;
        mean_b += b.coords * w;
        count += 1;
    }
    if count < 3 || !(total > 0.0) {
        return None;
    }
    (mean_a, mean_b) = (mean_a / total, mean_b / total);
    let mut covariance = Matrix3::zeros();
    for (a, b, w) in pairs.filter(|p| p.2 > 0.0) {
        covariance += (b.coords - mean_b) * (a.coords - mean_a).transpose() * w;
    }
    let svd = covariance.svd(true, true);
    let mut u = svd.u?;
    let v_t = svd.v_t?;
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| svd.singular_values[j].total_cmp(&svd.singular_values[i]));
    // Points on a line leave the rotation about it open.
    if svd.singular_values[order[1]] <= 1e-9 * svd.singular_values[order[0]] {
        return None;
    }
    // The best fit would be a reflection; reversing the weakest direction costs least.
    if (u.determinant() * v_t.determinant()) < 0.0 {
        let flipped = -u.column(order[2]);
        u.set_column(order[2], &flipped);
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * v_t));
    let translation = mean_b - rotation * mean_a;
    Some(Pose::from_parts(Translation3::from(translation), rotation))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_of_points_is_found_and_flat_sets_do_not_mirror() {
        let truth = Pose::new(Vector3::new(0.3, -0.2, 0.9), Vector3::new(0.4, 1.9, -0.7));
        for z in [0.0, 0.7] {
            let points: Vec<Point3<f64>> = (0..12)
                .map(|i| {
                    Point3::new(
                        (f64::from(i) * 1.7).sin(),
                        (f64::from(i) * 0.9).cos(),
                        z * (f64::from(i) * 2.1).sin(),
                    )
                })
                .collect();
            let pairs: Vec<_> = points.iter().map(|p| (*p, truth * p, 1.0)).collect();
            let found = rigid_fit(pairs.iter().copied()).unwrap();
            assert!(points.iter().all(|p| (found * p - truth * p).norm() < 1e-9));
            assert!(found.rotation.angle_to(&truth.rotation) < 1e-9);
        }
    }

    #[test]
    fn points_on_a_line_or_too_few_are_refused() {
        let line: Vec<_> = (0..5)
            .map(|i| (Point3::new(f64::from(i), 0.0, 0.0), Point3::new(0.0, f64::from(i), 1.0), 1.0))
            .collect();
        assert!(rigid_fit(line.iter().copied()).is_none());
        assert!(rigid_fit(line[..2].iter().copied()).is_none());
    }
}
