//! Boxes around points, and the cube of a reconstruction.

use nalgebra::{Point, Point3, RealField, Vector3};
use serde::{Deserialize, Serialize};

use super::Pose;

/// Half of the object's longest side as a share of the normalised cube's half side (docs/method.md 1.3).
/// derived: the published one
const FILL: f64 = 0.9;

/// Maps world meters to the normalised cube `[-1, 1]^3`: `normalised = (world - center) * scale`.
/// See docs/method.md (1.2).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneBox {
    /// World point at the cube's center, meters.
    pub center: Point3<f64>,
    /// Normalised units per meter.
    pub scale: f64,
}

impl SceneBox {
    /// The cube with the box `[lower, upper]` (meters, world) at `[-0.9, 0.9]` along its longest side.
    pub fn around_box(lower: &Point3<f64>, upper: &Point3<f64>) -> Self {
        // Even a single point gets a scale.
        let extent = (upper - lower).max().max(1e-6);
        Self { center: nalgebra::center(lower, upper), scale: 2.0 * FILL / extent }
    }

    /// World meters to `[-1, 1]^3`.
    pub fn normalise(&self, world: &Point3<f64>) -> Point3<f64> {
        Point3::from((world - self.center) * self.scale)
    }

    /// `[-1, 1]^3` to world meters.
    pub fn to_world(&self, normalised: &Point3<f64>) -> Point3<f64> {
        self.center + normalised.coords / self.scale
    }

    /// Converts a motion in the world, meters, to one of normalised points.
    pub fn normalised_motion(&self, world: &Pose) -> Pose {
        // x_n = s (x - c), y = R x + t  =>  y_n = R x_n + s (R c + t - c).
        Pose::from_parts(((world * self.center - self.center) * self.scale).into(), world.rotation)
    }

    /// Converts a motion of normalised points to one in the world, meters.
    pub fn world_motion(&self, normalised: &Pose) -> Pose {
        let c = self.center.coords;
        let t = c - normalised.rotation * c + normalised.translation.vector / self.scale;
        Pose::from_parts(t.into(), normalised.rotation)
    }

    /// Longest side of the object in meters.
    pub fn extent_m(&self) -> f64 {
        2.0 * FILL / self.scale
    }

    /// Side of the cube in meters.
    pub fn side_m(&self) -> f64 {
        2.0 / self.scale
    }
}

/// Evenly spread unit vectors (a Fibonacci lattice).
pub fn lattice_directions(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    let turn_rad = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
        let (sin, cos) = (turn_rad * i as f64).sin_cos();
        let r = (1.0 - z * z).sqrt();
        Vector3::new(r * cos, r * sin, z)
    })
}

/// Corners of an axis-aligned box: bit k of an index gives the side along axis k.
pub fn box_corners<T: RealField + Copy>(lower: &Point3<T>, upper: &Point3<T>) -> [Point3<T>; 8] {
    std::array::from_fn(|i| {
        Point3::from([0, 1, 2].map(|k| if i >> k & 1 == 0 { lower[k] } else { upper[k] }))
    })
}

/// Lower and upper corner of the axis-aligned box around points; `None` without any.
pub fn bounding_box<T: RealField + Copy, const D: usize>(
    points: impl IntoIterator<Item = Point<T, D>>,
) -> Option<(Point<T, D>, Point<T, D>)> {
    let mut points = points.into_iter();
    let first = points.next()?;
    Some(points.fold((first, first), |(lower, upper), p| (lower.inf(&p), upper.sup(&p))))
}

/// Whether `does` holds at a place and at the six places `distance_m` from it along the axes.
pub fn all_about(place: &Point3<f64>, distance_m: f64, does: impl Fn(&Point3<f64>) -> bool) -> bool {
    let mut shifts = (0..6).map(|k| Vector3::ith(k % 3, if k < 3 { distance_m } else { -distance_m }));
    does(place) && shifts.all(|shift| does(&(place + shift)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_and_six_about_it_are_asked() {
        let origin = Point3::origin();
        assert!(all_about(&origin, 0.1, |p| p.coords.norm() < 0.11));
        assert!(!all_about(&origin, 0.1, |p| p.coords.norm() > 0.01), "the place itself");
        for k in 0..6 {
            let axis = k % 3;
            let sign = if k < 3 { 1.0 } else { -1.0 };
            assert!(!all_about(&origin, 0.1, |p| sign * p[axis] < 0.05), "{k}");
        }
    }

    #[test]
    fn the_longest_side_spans_the_fill() {
        let b = SceneBox::around_box(&Point3::new(1.0, 2.0, 3.0), &Point3::new(1.5, 4.0, 3.1));
        assert!((b.normalise(&Point3::new(1.2, 4.0, 3.0)).y - 0.9).abs() < 1e-12);
        assert!((b.extent_m() - 2.0).abs() < 1e-12);
        let p = Point3::new(0.3, 0.2, -0.7);
        assert!((b.normalise(&b.to_world(&p)) - p).norm() < 1e-12);
        let motion = Pose::new(Vector3::new(0.3, -0.1, 0.2), Vector3::new(0.5, 0.7, -0.4));
        let normalised = b.normalised_motion(&motion);
        assert!((b.to_world(&(normalised * p)) - motion * b.to_world(&p)).norm() < 1e-12);
        assert!((b.world_motion(&normalised) * p - motion * p).norm() < 1e-12);
    }
}
