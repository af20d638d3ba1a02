//! Rigid motions from velocities and from small vectors.

use nalgebra::{UnitQuaternion, Vector3};

use geometry::Pose;

/// Motion at a constant twist for some seconds; the twist holds linear and angular velocity in the moving
/// frame.
pub fn twist_motion([t, w]: &[Vector3<f64>; 2], seconds: f64) -> Pose {
    let rate = w.norm();
    let turn = w * seconds;
    // The closed form divides by the angular rate.
    if rate * seconds.abs() < 1e-9 {
        return small_motion(&(t * seconds), &turn);
    }
    let angle = rate * seconds;
    let n = w / rate;
    let across = n.cross(t);
    // The integrated linear velocity: an arc across the axis, a straight line along it.
    let path = t * (angle.sin() / rate)
        + across * ((1.0 - angle.cos()) / rate)
        + n * (n.dot(t) * (angle - angle.sin()) / rate);
    small_motion(&path, &turn)
}

/// A small rigid motion: translation and rotation vector.
pub fn small_motion(t: &Vector3<f64>, w: &Vector3<f64>) -> Pose {
    Pose::from_parts((*t).into(), UnitQuaternion::from_scaled_axis(*w))
}
