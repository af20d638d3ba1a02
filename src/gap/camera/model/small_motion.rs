//! Rigid motions from velocities and small vectors.

use nalgebra::{UnitQuaternion, Vector3};

use geometry::Pose;

/// A motion at a constant twist: velocities of the origin and of rotation in the moving frame, for a time.
#[must_use]
pub fn twist_motion([t, w]: &[Vector3<f64>; 2], seconds: f64) -> Pose {
    let rate = w.norm();
    let turn = w * seconds;
    // The closed form divides by the rate.
    if rate * seconds.abs() < 1e-9 {
        return small_motion(&(t * seconds), &turn);
    }
    let angle = rate * seconds;
    let n = w / rate;
    let across = n.cross(t);
    // Integral of the turning velocity: an arc across the axis, a straight way along it.
    let path = t * (angle.sin() / rate)
        + across * ((1.0 - angle.cos()) / rate)
        + n * (n.dot(t) * (angle - angle.sin()) / rate);
    small_motion(&path, &turn)
}

/// A small rigid motion: translation and rotation vector.
#[must_use]
pub fn small_motion(t: &Vector3<f64>, w: &Vector3<f64>) -> Pose {
    Pose::from_parts((*t).into(), UnitQuaternion::from_scaled_axis(*w))
}
