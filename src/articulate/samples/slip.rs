//! Slips: small motions of a surface within itself, which do not change the distances to its planes (Gelfand
//! and Guibas 2004).

use nalgebra::{Matrix6, Point3, SymmetricEigen, Unit, UnitQuaternion, Vector3, Vector6};

use geometry::{Pose, Screw};
use numeric::statistics::median;

/// Fewer points than this have no meaningful slips.
const LEAST_POINTS: usize = 12;

/// A surface is round if the twist about its axis changes it by less than this share of any other twist's
/// change.
///
/// tuned: random objects (eval/random_objects.md)
const ROUND: f64 = 0.02;
/// Least mean squared change by a unit twist that leaves the surface; twists within a flat surface change it
/// less.
///
/// tuned: random objects (eval/random_objects.md)
const HELD: f64 = 0.01;
/// Least rotation in a unit twist about an axis through the surface.
///
/// derived: it turns more than it shifts
const TURNS: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Iterations to find an axis.
const SETTLING: usize = 10;

/// A twist about a center.
pub(crate) struct Slip {
    /// Rotation vector per meter of step.
    turn: Vector3<f64>,
    /// Displacement of the center per meter of step.
    shift: Vector3<f64>,
    center: Point3<f64>,
}

impl Slip {
    /// A shift along a unit direction.
    pub(crate) fn along_direction(direction: Vector3<f64>) -> Self {
        Self { turn: Vector3::zeros(), shift: direction, center: Point3::origin() }
    }

    /// The motion of a step: points at the root mean square distance from the center move by about `step_m`.
    pub(crate) fn motion_by(&self, step_m: f64) -> Pose {
        let center = self.center.coords;
        let turn = UnitQuaternion::from_scaled_axis(self.turn * step_m);
        Pose::from_parts((center + self.shift * step_m - turn * center).into(), turn)
    }
}

/// How unit twists about the center of a surface change the distances of its points from their planes.
struct Changes {
    /// Change by each component of a twist (turn in radii, shift), one row per point.
    rows: Vec<Vector6<f64>>,
    center: Point3<f64>,
    radius_m: f64,
}

impl Changes {
    /// `None` for too few points.
    fn of_surface(points: &[Point3<f64>], normals: &[Vector3<f64>]) -> Option<Self> {
        let n = points.len() as f64;
        let center = Point3::from(points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / n);
        let radius_m = (points.iter().map(|p| (p - center).norm_squared()).sum::<f64>() / n).sqrt();
        if points.len() < LEAST_POINTS || radius_m <= 0.0 {
            return None;
        }
        let mut rows = Vec::with_capacity(points.len());
        for (point, normal) in points.iter().zip(normals) {
            // In radii, a unit turn moves the surface about as far as a unit shift.
            let turn = (point - center).cross(normal) / radius_m;
            rows.push(Vector6::new(turn.x, turn.y, turn.z, normal.x, normal.y, normal.z));
        }
        Some(Self { rows, center, radius_m })
    }

    /// Mean squared change and twist, the least change first; `weight` gives the weight of every point.
    fn twists(&self, weight: impl Fn(&Vector6<f64>) -> f64) -> [(f64, Vector6<f64>); 6] {
        let information: Matrix6<f64> = self.rows.iter().map(|r| r * r.transpose() * weight(r)).sum();
        let eigen = SymmetricEigen::new(information / self.rows.len() as f64);
        let mut twists =
            [0, 1, 2, 3, 4, 5].map(|k| (eigen.eigenvalues[k], eigen.eigenvectors.column(k).into_owned()));
        twists.sort_by(|a, b| a.0.total_cmp(&b.0));
        twists
    }

    fn slip_of(&self, twist: &Vector6<f64>) -> Slip {
        let turn = twist.fixed_rows::<3>(0) / self.radius_m;
        let shift = twist.fixed_rows::<3>(3).into_owned();
        Slip { turn, shift, center: self.center }
    }
}

/// The three twists that least change the distances of points from their planes, the least first; `None` for
/// too few points.
pub(crate) fn least_slips(points: &[Point3<f64>], normals: &[Vector3<f64>]) -> Option<[Slip; 3]> {
    let changes = Changes::of_surface(points, normals)?;
    let twists = changes.twists(|_| 1.0);
    Some([0, 1, 2].map(|k| changes.slip_of(&twists[k].1)))
}

/// The axis about which a surface is round: apart from marks (Geman and McClure weights) it can turn within
/// itself, but not slide. `None` for any other surface.
pub(crate) fn round_axis(points: &[Point3<f64>], normals: &[Vector3<f64>]) -> Option<Screw> {
    let changes = Changes::of_surface(points, normals)?;
    let mut twists = changes.twists(|_| 1.0);
    for _ in 0..SETTLING {
        let least = twists[0].1;
        // Marks such as a handle leave the surface when it turns: their weight falls until the rest decides.
        let scale = 3.0 * median(changes.rows.iter().map(|r| r.dot(&least).abs()).collect())?;
        twists = changes.twists(|r| (1.0 + (r.dot(&least) / scale.max(1e-9)).powi(2)).powi(-2));
    }
    let slip = changes.slip_of(&twists[0].1);
    let direction = Unit::try_new(slip.turn, TURNS / changes.radius_m)?;
    // The point of the screw's axis nearest to the center.
    let point = slip.center + slip.turn.cross(&slip.shift) / slip.turn.norm_squared();
    // Exactly one slip: a ball and a plane have three each, and no axis.
    (twists[0].0 < ROUND * twists[1].0 && twists[1].0 > HELD).then_some(Screw {
        direction,
        point,
        angle_rad: 0.0,
        advance_m: 0.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_slips_in_itself_and_nowhere_else() {
        let normal = Vector3::new(1.0, 2.0, -0.5).normalize();
        let a = normal.cross(&Vector3::x()).normalize();
        let b = normal.cross(&Vector3::y()).normalize();
        let point =
            |i: usize| Point3::new(0.3, -1.0, 2.0) + a * (0.1 * (i % 7) as f64) + b * (0.07 * (i / 7) as f64);
        let points: Vec<_> = (0..49).map(point).collect();
        let all = least_slips(&points, &[normal; 49]).unwrap();
        for slip in &all {
            for p in &points {
                assert!(normal.dot(&(slip.motion_by(0.01) * p - p)).abs() < 1e-4);
            }
        }
        let moved =
            |slip: &Slip| points.iter().map(|p| (slip.motion_by(0.01) * p - p).norm()).fold(0.0, f64::max);
        assert!(all.iter().all(|s| moved(s) > 0.005));
        assert!(least_slips(&points[..5], &[normal; 5]).is_none());
        assert!(round_axis(&points, &[normal; 49]).is_none());
    }

    #[test]
    fn a_cap_with_a_bar_is_round_and_a_block_is_not() {
        let pose = Pose::new(Vector3::new(0.3, -0.2, 1.0), Vector3::new(0.5, 0.1, -0.4));
        // Sides and top of a prism with so many sides, and a bar on it, away from its middle.
        let prism = |sides: f64| {
            let mut surface: Vec<(Point3<f64>, Vector3<f64>)> = Vec::new();
            for k in 0..240 {
                let angle = std::f64::consts::TAU * f64::from(k % 60) / 60.0;
                let face = (angle / std::f64::consts::TAU * sides).round() * std::f64::consts::TAU / sides;
                let side = Vector3::new(face.cos(), face.sin(), 0.0);
                let radius_m = 0.04 / (angle - face).cos();
                let at = |r: f64, z: f64| Point3::new(r * angle.cos(), r * angle.sin(), z);
                surface.push((at(radius_m, 0.006 * f64::from(k / 60)), side));
                surface.push((at(radius_m * f64::from(1 + k / 60) / 5.0, 0.02), Vector3::z()));
            }
            for k in 0..60 {
                let x = -0.01 + 0.0008 * f64::from(k % 30);
                let z = 0.022 + 0.006 * f64::from(k / 30);
                surface.extend(
                    [0.008, -0.008].map(|y| (Point3::new(x, y, z), Vector3::new(0.0, f64::signum(y), 0.0))),
                );
            }
            surface.into_iter().map(|(p, n)| (pose * p, pose * n)).unzip::<_, _, Vec<_>, Vec<_>>()
        };
        let (points, normals) = prism(360.0);
        let axis = round_axis(&points, &normals).unwrap();
        assert!(axis.direction.dot(&(pose * Vector3::z())).abs() > 0.9999, "{:?}", axis.direction);
        let off = pose.inverse_transform_point(&axis.point);
        assert!(off.x.hypot(off.y) < 5e-4, "{off}");
        let (points, normals) = prism(4.0);
        assert!(round_axis(&points, &normals).is_none());
    }
}
