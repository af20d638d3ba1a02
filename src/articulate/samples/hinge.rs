//! Scores how plausible the place of a hinge is: close to both of its parts.

use nalgebra::{Point3, Unit, Vector3};

use geometry::{Pose, Screw};

/// Sum of the distances of an axis from both parts' surfaces at which the score of a hinge is one half, as a
/// share of the object's longest side.
/// tuned: shared/bags
pub(crate) const HINGE: f64 = 0.05;
/// A smaller turn is not a hinge's, and planes at a smaller angle are parallel, radians.
/// tuned: shared/bags
pub(crate) const PARALLEL: f64 = 0.1;

/// How well a motion of one part relative to another could be that of a hinge, from 0 to 1. `off_m` is the
/// distance of its axis from both parts or, for a slide, of the parts from each other, meters.
pub(crate) fn hinge_score(off_m: f64, extent_m: f64) -> f64 {
    1.0 / (1.0 + (off_m / (HINGE * extent_m)).powi(2))
}

/// The axis of a turning motion.
pub(crate) fn axis_of_turn(motion: &Pose) -> Option<Screw> {
    Screw::of_motion(motion).filter(|s| s.angle_rad.abs() > PARALLEL)
}

/// Sum of the distances of an axis from the surfaces of two parts, meters; of the second only where the first
/// is beside it. A hinge is close to both; the axis of another turn may be in thin air.
pub(crate) fn axis_off_m(
    point: &Point3<f64>,
    direction: &Unit<Vector3<f64>>,
    part: &[Point3<f64>],
    parent: &[Point3<f64>],
) -> f64 {
    let along = |p: &Point3<f64>| direction.dot(&(p - point));
    let distance_m = |p: &Point3<f64>| ((p - point) - direction.into_inner() * along(p)).norm();
    let [low, high] =
        part.iter().map(along).fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], x| [lo.min(x), hi.max(x)]);
    // The parent must be near the axis beside the part: somewhere along the line it nearly always is.
    let beside = parent.iter().filter(|p| (low..=high).contains(&along(p)));
    let own_m = part.iter().map(distance_m).fold(f64::INFINITY, f64::min);
    own_m + beside.map(distance_m).fold(f64::INFINITY, f64::min)
}

/// Distance between some points of two surfaces, meters.
pub(crate) fn touch_m(part: &[Point3<f64>], other: &[Point3<f64>]) -> f64 {
    let [part, other] = [every_few_points(part), every_few_points(other)];
    part.iter().flat_map(|p| other.iter().map(move |o| (p - o).norm())).fold(f64::INFINITY, f64::min)
}

/// At most 500 points, evenly taken in their order.
fn every_few_points(points: &[Point3<f64>]) -> Vec<Point3<f64>> {
    const SOME: usize = 500;
    points.iter().step_by(points.len().div_ceil(SOME).max(1)).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plate in the plane y = 0 from x = `from_m`, 0.2 m square.
    fn plate(from_m: f64) -> Vec<Point3<f64>> {
        (0..441)
            .map(|i| Point3::new(from_m + 0.01 * f64::from(i % 21), 0.0, 0.01 * f64::from(i / 21)))
            .collect()
    }

    #[test]
    fn a_hinge_runs_by_both_plates_and_other_axes_do_not() {
        let part = plate(0.01);
        let parent = plate(-0.21);
        let off = |x: f64, y: f64| axis_off_m(&Point3::new(x, y, 5.0), &Vector3::z_axis(), &part, &parent);
        assert!((off(0.0, 0.0) - 0.02).abs() < 1e-9);
        assert!((off(0.11, 0.0) - 0.12).abs() < 1e-9);
        assert!(off(0.0, 0.3) > 0.5);
        // Beside the part alone, not above it.
        let above: Vec<Point3<f64>> = parent.iter().map(|p| p + Vector3::z()).collect();
        assert!(axis_off_m(&Point3::origin(), &Vector3::z_axis(), &part, &above).is_infinite());
        assert!((touch_m(&part, &parent) - 0.02).abs() < 0.01);
    }
}
