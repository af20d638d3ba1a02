//! Chooses the direction from which a joint is drawn: orthographic, gravity down, with axis and motion in
//! sight.

use nalgebra::{Point3, Unit, Vector3};

use gap::twin_tree::Motion;

/// Angle between the line of sight and the axis of a turning joint, degrees: its motion appears as an open
/// arc.
/// chosen: for the eye
const TURN_DEG: f64 = 48.0;
/// The same for a sliding joint: its travel appears long. chosen: for the eye
const SLIDE_DEG: f64 = 68.0;
/// Elevations of the viewer, degrees. chosen: for the eye
const HEIGHTS_DEG: [f64; 3] = [18.0, 28.0, 40.0];
/// Number of candidate directions around the joint.
const PLACES: usize = 24;
/// Cost of a part that points at the viewer, in radians of the axis angle. chosen: for the eye
const POINTING: f64 = 0.35;

/// A line of sight and a scale.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    /// Unit vector to the viewer.
    pub toward: Vector3<f64>,
    right: Vector3<f64>,
    up: Vector3<f64>,
    scale: f64,
    shift: (f64, f64),
}

impl View {
    /// The best of some views for an axis and a part that extends from it by `arm`.
    pub(super) fn best_view(
        motion: Motion,
        axis: &Unit<Vector3<f64>>,
        arm: &Vector3<f64>,
        gravity: &Vector3<f64>,
    ) -> Self {
        let up = (-gravity).try_normalize(1e-9).unwrap_or_else(Vector3::z);
        let aside = if up.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
        let ahead = (aside - up * up.dot(&aside)).normalize();
        let left = up.cross(&ahead);
        let arm = arm.try_normalize(1e-12).unwrap_or_else(Vector3::zeros);
        let wanted = if motion == Motion::Turn { TURN_DEG } else { SLIDE_DEG }.to_radians();
        let mut best: Option<(f64, Vector3<f64>)> = None;
        for height in HEIGHTS_DEG {
            for place in 0..PLACES {
                let around = std::f64::consts::TAU * place as f64 / PLACES as f64;
                let (s, c) = around.sin_cos();
                let (rise, flat) = height.to_radians().sin_cos();
                let toward = (ahead * c + left * s) * flat + up * rise;
                let angle = axis.dot(&toward).abs().min(1.0).acos();
                // A small preference for height makes the choice between equal views unique.
                let cost = (angle - wanted).abs()
                    + POINTING * arm.dot(&toward).abs()
                    + 1e-3 * height
                    + 1e-6 * place as f64;
                if best.is_none_or(|(least, _)| cost < least) {
                    best = Some((cost, toward));
                }
            }
        }
        let toward = best.map_or_else(Vector3::x, |(_, t)| t);
        let right = up.cross(&toward).normalize();
        Self { toward, right, up: toward.cross(&right), scale: 1.0, shift: (0.0, 0.0) }
    }

    /// The view scaled and shifted so that all points fit on a sheet of this size, within its border.
    #[must_use]
    pub(super) fn fitted_to(self, points: &[Point3<f64>], size: (f64, f64), border: f64) -> Self {
        let flat = Self { scale: 1.0, shift: (0.0, 0.0), ..self };
        let mut low = (f64::INFINITY, f64::INFINITY);
        let mut high = (f64::NEG_INFINITY, f64::NEG_INFINITY);
        for p in points {
            let (x, y) = flat.point_on_sheet(p);
            low = (low.0.min(x), low.1.min(y));
            high = (high.0.max(x), high.1.max(y));
        }
        let room = (size.0 - 2.0 * border, size.1 - 2.0 * border);
        let scale = (room.0 / (high.0 - low.0).max(1e-9)).min(room.1 / (high.1 - low.1).max(1e-9));
        let shift =
            (0.5 * size.0 - scale * 0.5 * (low.0 + high.0), 0.5 * size.1 - scale * 0.5 * (low.1 + high.1));
        Self { scale, shift, ..self }
    }

    /// A point on the sheet, y down.
    pub(super) fn point_on_sheet(&self, p: &Point3<f64>) -> (f64, f64) {
        let (x, y) = self.direction_on_sheet(&p.coords);
        (self.shift.0 + self.scale * x, self.shift.1 + self.scale * y)
    }

    /// A direction on the sheet, y down; a unit vector in the sheet has length 1.
    pub(super) fn direction_on_sheet(&self, v: &Vector3<f64>) -> (f64, f64) {
        (self.right.dot(v), -self.up.dot(v))
    }

    /// Unit vector that points down on the sheet.
    pub(super) fn sheet_down(&self) -> Vector3<f64> {
        -self.up
    }

    /// Unit vector to the light, at the viewer's upper left.
    pub(super) fn light_direction(&self) -> Vector3<f64> {
        (self.toward + 0.9 * self.up - 0.6 * self.right).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gravity_points_down_and_the_sheet_is_no_mirror() {
        for (axis, gravity) in [
            (Vector3::z_axis(), Vector3::new(0.0, 0.0, -9.81)),
            (Vector3::y_axis(), Vector3::new(0.0, -9.81, 0.0)),
            (Vector3::x_axis(), Vector3::zeros()),
        ] {
            let view = View::best_view(Motion::Turn, &axis, &Vector3::new(0.3, 0.1, 0.0), &gravity);
            if gravity.norm() > 0.0 {
                let (x, y) = view.direction_on_sheet(&gravity);
                assert!(x.abs() < 1e-9 && y > 0.0, "{x} {y}");
            }
            assert!((view.right.cross(&view.up) - view.toward).norm() < 1e-9);
            // A turn about the line of sight is counterclockwise on the sheet, whose y is down.
            let from = view.direction_on_sheet(&view.right);
            let to = view.direction_on_sheet(&view.toward.cross(&view.right));
            assert!(from.0 > 0.0 && to.1 < 0.0);
            let angle = axis.dot(&view.toward).abs().acos().to_degrees();
            assert!((angle - TURN_DEG).abs() < 15.0, "{angle}");
        }
    }
}
