//! Detects parts that look alike all around an axis: their turn about it is not observable.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Point3, Unit, Vector3};

use crate::{
    joints::{free_motion::surface_sigma_m, motion_evidence::MotionEvidence},
    observations::SurfaceSamples,
};
use geometry::{Pose, Screw};
use numeric::statistics::median;

/// Number of turns tried, all around; only a regular prism of seven sides would look alike after each.
const TURNS: usize = 7;
/// A turned part fits as well if this share of its agreement remains.
///
/// tuned: shared/bags
const AS_WELL: f64 = 0.9;
/// A turn counts only if more than this share of the points moves to a place seen before.
///
/// chosen: the majority
const SEEN: f64 = 0.5;
/// Iterations to find the axis of a part.
const CENTERINGS: usize = 10;

/// Whether a part would fit as well if, before its motion, it were turned about a direction by any angle.
pub(crate) fn looks_alike_round(
    evidence: &MotionEvidence,
    motion: &Pose,
    direction: &Unit<Vector3<f64>>,
) -> bool {
    let sigma_m = surface_sigma_m(evidence, motion);
    let Some(center) = axis_center(evidence.surfaces[0], direction) else { return false };
    let mut agreements = (0..TURNS).map(|k| {
        let angle_rad = TAU * k as f64 / TURNS as f64;
        let turn = Screw { direction: *direction, point: center, angle_rad, advance_m: 0.0 };
        let q = evidence.linearise(&(motion * turn.to_motion()), sigma_m);
        (q.inliers as f64, q.tried as f64)
    });
    let Some((inliers, tried)) = agreements.next() else { return false };
    // A turn that moves most of the part to unseen places shows nothing.
    let seen: Vec<(f64, f64)> = agreements.filter(|(_, t)| *t > SEEN * tried).collect();
    seen.len() >= 2 && seen.iter().all(|(i, t)| i * tried > AS_WELL * inliers * t)
}

/// A point of the line along a direction that most normals of a surface meet: least squares with robust
/// weights (Geman and McClure) by how far they miss it, as marks on a round part have other normals; `None`
/// for too few points.
fn axis_center(surface: &SurfaceSamples, direction: &Unit<Vector3<f64>>) -> Option<Point3<f64>> {
    let u = direction.into_inner();
    // The normal n at x meets the axis u through c where (x - c) x n has no component along u: linear in c.
    let across: Vec<(Vector3<f64>, f64)> = surface
        .points
        .iter()
        .zip(&surface.normals)
        .map(|(x, n)| (n.cross(&u), x.coords.cross(n).dot(&u)))
        .collect();
    let mut center = None;
    for _ in 0..CENTERINGS {
        let passes =
            |(a, b): &(Vector3<f64>, f64)| center.map_or(0.0, |c: Vector3<f64>| (a.dot(&c) - b).abs());
        // Normals along the axis, such as a lid's, always meet it: they do not count for the scale.
        let median_m = median(across.iter().filter(|(a, _)| a.norm() > 0.5).map(passes).collect())?;
        // Any point along the axis will do; the first term picks the one at the origin's height.
        let mut matrix = u * u.transpose();
        let mut right = Vector3::zeros();
        for line in &across {
            let weight =
                if median_m > 0.0 { (1.0 + (passes(line) / (2.0 * median_m)).powi(2)).powi(-2) } else { 1.0 };
            matrix += line.0 * line.0.transpose() * weight;
            right += line.0 * (line.1 * weight);
        }
        let inverse: Matrix3<f64> = matrix.try_inverse()?;
        center = Some(inverse * right);
    }
    center.map(Point3::from)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joints::drawn_residuals::DrawnResiduals;
    use geometry::{Grid3, SceneBox};

    /// A part with so many sides round a vertical axis through (.1, .05), seen in two states, lifted by 2 cm
    /// between them.
    fn alike(sides: f64) -> bool {
        const RADIUS_M: f64 = 0.06;
        let middle = Point3::new(0.1, 0.05, 0.0);
        let lift = Pose::translation(0.0, 0.0, 0.02);
        let facing = |angle: f64| {
            let face = (angle / TAU * sides).round() * TAU / sides;
            (Vector3::new(face.cos(), face.sin(), 0.0), RADIUS_M / (angle - face).cos())
        };
        let distance_m = |p: &Point3<f64>| {
            let v = p - middle;
            let (normal, _) = facing(v.y.atan2(v.x));
            (normal.dot(&v) - RADIUS_M).max(v.z.abs() - 0.03)
        };
        let around = SceneBox::around_box(&Point3::new(-0.05, -0.1, -0.15), &Point3::new(0.25, 0.2, 0.15));
        let seen = Grid3::over_scene(&around, 101, true);
        let sdf = [Pose::identity(), lift].map(|pose| {
            let mut grid = Grid3::over_scene(&around, 101, 0.0f32);
            (0..grid.values.len()).for_each(|i| {
                grid.values[i] = distance_m(&pose.inverse_transform_point(&grid.position_of_index(i))) as f32
            });
            grid
        });
        let surfaces = [Pose::identity(), lift].map(|pose| {
            let mut s = SurfaceSamples::default();
            for i in 0..1200 {
                let angle = TAU * (i % 60) as f64 / 60.0;
                let (normal, radius_m) = facing(angle);
                let at = Vector3::new(
                    radius_m * angle.cos(),
                    radius_m * angle.sin(),
                    0.0028 * (i / 60) as f64 - 0.027,
                );
                s.points.push(pose * (middle + at));
                s.normals.push(normal);
                s.colors.push([0.5; 3]);
            }
            s
        });
        let evidence = MotionEvidence {
            surfaces: [&surfaces[0], &surfaces[1]],
            sdf: [&sdf[0], &sdf[1]],
            offsets_m: [&[]; 2],
            visible: [&seen, &seen],
            matches: &[],
            independent_area_m2: 1e-4,
            areas_m2: [0.02; 2],
            reach_m: 0.02,
            block_m: 0.02,
            displacement_m: 0.0,
            patch_m: 0.05,
            drawn: &DrawnResiduals::default(),
        };
        looks_alike_round(&evidence, &lift, &Vector3::z_axis())
    }

    #[test]
    fn a_cap_does_and_a_block_does_not() {
        assert!(alike(360.0));
        assert!(!alike(4.0) && !alike(6.0));
    }
}
