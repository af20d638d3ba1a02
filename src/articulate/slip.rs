//! Slips: small motions that a surface makes within itself, which no distance between planes shows (Gelfand and Guibas 2004).

use nalgebra::{Matrix6, Point3, SymmetricEigen, UnitQuaternion, Vector3, Vector6};

use crate::geometry::Pose;

/// Fewer points have no slips that mean anything.
const LEAST_POINTS: usize = 12;

/// A twist about a center.
pub(super) struct Slip {
    /// Rotation vector per metre of the step.
    turn: Vector3<f64>,
    /// Displacement of the center per metre of the step.
    shift: Vector3<f64>,
    center: Point3<f64>,
}

impl Slip {
    /// A shift along a unit direction.
    pub fn along(direction: Vector3<f64>) -> Self {
        Self { turn: Vector3::zeros(), shift: direction, center: Point3::origin() }
    }

    /// The motion by a step: points at the root mean square distance from the center move by about `step_m`.
    pub fn by(&self, step_m: f64) -> Pose {
        let center = self.center.coords;
        let turn = UnitQuaternion::from_scaled_axis(self.turn * step_m);
        Pose::from_parts((center + self.shift * step_m - turn * center).into(), turn)
    }
}

/// The three twists that least change the distances of points with normals from their planes, the least first; `None` for
/// too few points.
pub(super) fn slips(surface: &[(Point3<f64>, Vector3<f64>)]) -> Option<[Slip; 3]> {
    let n = surface.len() as f64;
    let center = Point3::from(surface.iter().map(|(p, _)| p.coords).sum::<Vector3<f64>>() / n);
    let radius_m = (surface.iter().map(|(p, _)| (p - center).norm_squared()).sum::<f64>() / n).sqrt();
    if surface.len() < LEAST_POINTS || radius_m <= 0.0 {
        return None;
    }
    let row = |(point, normal): &(Point3<f64>, Vector3<f64>)| {
        let turn = (point - center).cross(normal) / radius_m;
        Vector6::new(turn.x, turn.y, turn.z, normal.x, normal.y, normal.z)
    };
    let information: Matrix6<f64> = surface.iter().map(|s| row(s) * row(s).transpose()).sum();
    let eigen = SymmetricEigen::new(information);
    let mut order = [0, 1, 2, 3, 4, 5];
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    let slip = |k: usize| {
        let twist = eigen.eigenvectors.column(k);
        Slip { turn: Vector3::new(twist[0], twist[1], twist[2]) / radius_m, shift: Vector3::new(twist[3], twist[4], twist[5]), center }
    };
    Some([slip(order[0]), slip(order[1]), slip(order[2])])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_slips_in_itself_and_nowhere_else() {
        let normal = Vector3::new(1.0, 2.0, -0.5).normalize();
        let (a, b) = (normal.cross(&Vector3::x()).normalize(), normal.cross(&Vector3::y()).normalize());
        let point = |i: usize| Point3::new(0.3, -1.0, 2.0) + a * (0.1 * (i % 7) as f64) + b * (0.07 * (i / 7) as f64);
        let surface: Vec<_> = (0..49).map(|i| (point(i), normal)).collect();
        let all = slips(&surface).unwrap();
        for slip in &all {
            for (p, n) in &surface {
                assert!(n.dot(&(slip.by(0.01) * p - p)).abs() < 1e-4);
            }
        }
        let moved = |slip: &Slip| surface.iter().map(|(p, _)| (slip.by(0.01) * p - p).norm()).fold(0.0, f64::max);
        assert!(all.iter().all(|s| moved(s) > 0.005));
        assert!(slips(&surface[..5]).is_none());
    }
}
