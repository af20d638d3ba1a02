//! Choice of frames with the most different views of the object.

use nalgebra::{Matrix3, Point3, Vector3};

use geometry::Pose;

/// Indices, increasing, of at most `budget` poses with views as different as possible: farthest-point
/// sampling from the pose nearest to the mean. The distance of two views is the angle between their optical
/// axes plus the angle between their centers as seen from the common focus. See docs/method.md (2.4).
#[must_use]
pub fn spread_views(world_from_camera: &[Pose], budget: usize) -> Vec<usize> {
    let count = world_from_camera.len();
    if count <= budget {
        return (0..count).collect();
    }
    let centers: Vec<Vector3<f64>> = world_from_camera.iter().map(|p| p.translation.vector).collect();
    let mean = centers.iter().sum::<Vector3<f64>>() / count as f64;
    let focus = common_focus(world_from_camera).map_or(mean, |p| p.coords);
    let range = (centers.iter().map(|c| (c - focus).norm()).sum::<f64>() / count as f64).max(1e-6);
    let middle =
        (0..count).min_by(|a, b| (centers[*a] - mean).norm().total_cmp(&(centers[*b] - mean).norm()));
    let mut chosen: Vec<usize> = middle.into_iter().take(budget).collect();
    let mut gap = vec![f64::INFINITY; count];
    while let Some(last) = chosen.last().copied().filter(|_| chosen.len() < budget) {
        for (i, g) in gap.iter_mut().enumerate() {
            *g = g.min(view_distance(&world_from_camera[i], &world_from_camera[last], range));
        }
        // The first of equally far poses: only a greater distance replaces it.
        let farthest = (0..count).fold(0, |best, i| if gap[i] > gap[best] { i } else { best });
        // Rounding may leave a distance between equal poses.
        if gap[farthest] <= 1e-6 {
            break;
        }
        chosen.push(farthest);
    }
    // Back in time order, along which drift accumulates.
    chosen.sort_unstable();
    chosen
}

/// docs/method.md (2.4): a shift over the mean distance is about the angle it subtends.
fn view_distance(a: &Pose, b: &Pose, mean_distance_m: f64) -> f64 {
    let axes = [a, b].map(|pose| pose.rotation * Vector3::z());
    let turned = axes[0].dot(&axes[1]).clamp(-1.0, 1.0).acos();
    (a.translation.vector - b.translation.vector).norm() / mean_distance_m + turned
}

/// The point nearest to all optical axes by least squares; `None` where the axes are nearly parallel. See
/// docs/method.md (2.5).
#[must_use]
pub fn common_focus(world_from_camera: &[Pose]) -> Option<Point3<f64>> {
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for pose in world_from_camera {
        let axis = pose.rotation * Vector3::z();
        // Projection onto the plane normal to the axis: the square of the result is the squared distance.
        let across = Matrix3::identity() - axis * axis.transpose();
        normal += across;
        right += across * pose.translation.vector;
    }
    // Parallel axes have no nearest point: docs/method.md (2.5).
    let smallest = normal.symmetric_eigenvalues().min();
    (smallest > 1e-3 * world_from_camera.len() as f64).then_some(())?;
    Some(Point3::from(normal.try_inverse()? * right))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn around(target: Point3<f64>, angles: impl Iterator<Item = f64>) -> Vec<Pose> {
        let pose = |a: f64| {
            let eye = target + Vector3::new(a.cos(), a.sin(), 0.4);
            // face_towards points z at the target; the optical frame's y is down.
            Pose::face_towards(&eye, &target, &-Vector3::z())
        };
        angles.map(pose).collect()
    }

    #[test]
    fn the_focus_is_where_the_cameras_look() {
        let target = Point3::new(0.3, -0.2, 0.1);
        let poses = around(target, (0..9).map(|i| f64::from(i) * 0.3));
        assert!((common_focus(&poses).unwrap() - target).norm() < 1e-9);
        let parallel: Vec<_> = (0..5).map(|i| Pose::translation(f64::from(i), 0.0, 0.0)).collect();
        assert_eq!(common_focus(&parallel), None);
    }

    #[test]
    fn a_long_stand_gives_one_frame_and_the_sweep_the_rest() {
        // 200 frames from one place, then a sweep of 20.
        let stand = std::iter::repeat_n(0.0, 200);
        let poses = around(Point3::origin(), stand.chain((1..=20).map(|i| f64::from(i) * 0.1)));
        let chosen = spread_views(&poses, 11);
        assert_eq!(chosen.len(), 11);
        assert_eq!(chosen.iter().filter(|i| **i < 200).count(), 1);
        assert!(chosen.contains(&219));
        let gaps: Vec<_> = chosen[1..].windows(2).map(|w| w[1] - w[0]).collect();
        assert!(gaps.iter().all(|g| (1..=4).contains(g)), "{gaps:?}");
    }

    #[test]
    fn a_budget_that_suffices_keeps_all_and_copies_are_not_kept() {
        let poses = around(Point3::origin(), (0..5).map(f64::from));
        assert_eq!(spread_views(&poses, 5), [0, 1, 2, 3, 4]);
        assert_eq!(spread_views(&around(Point3::origin(), std::iter::repeat_n(0.0, 9)), 3).len(), 1);
    }
}
