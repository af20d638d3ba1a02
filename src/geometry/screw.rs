//! Screw axes: the line about which a part turns or along which it slides.
//!
//! Turning by `angle_rad` about a directed line also advances `pitch_m_per_rad * angle_rad` along it. A pure
//! rotation has pitch zero; a pure translation has a direction and no location.

use nalgebra::{Point3, Translation3, Unit, UnitQuaternion, Vector3, Vector6};
use serde::{Deserialize, Serialize};

use super::Pose;

/// Below this sine two directions count as parallel. chosen: above rounding, below any reading
const PARALLEL_SIN: f64 = 1e-6;
/// Below this angle in radians a motion has no observable rotation axis.
/// chosen: above rounding, below any reading
const MIN_ANGLE_RAD: f64 = 1e-9;

/// The screw of a rigid motion: direction, the point of its line closest to the origin, angle and advance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Screw {
    /// Unit direction.
    pub direction: Unit<Vector3<f64>>,
    /// Point of the axis closest to the frame's origin, meters; the origin for a pure translation.
    pub point: Point3<f64>,
    /// Rotation about the direction, radians, in `[0, pi]`.
    pub angle_rad: f64,
    /// Translation along the direction, meters.
    pub advance_m: f64,
}

impl Screw {
    /// Screw of a rigid motion by docs/method.md (1.3): closed-form pivot `p = (t + cot(angle/2) u x t) / 2`
    /// with the component of `t` perpendicular to `u`. `None` for the identity.
    pub fn of_motion(motion: &Pose) -> Option<Self> {
        let w = log_so3(&motion.rotation);
        let angle_rad = w.norm();
        let t = motion.translation.vector;
        // Such a small turn shows no axis: the motion counts as a translation (docs/method.md 1.4).
        if angle_rad < MIN_ANGLE_RAD {
            let direction = Unit::try_new(t, 1e-12)?;
            return Some(Self { direction, point: Point3::origin(), angle_rad: 0.0, advance_m: t.norm() });
        }
        let direction = Unit::try_new(w, 0.0)?;
        let u = direction.into_inner();
        let advance_m = t.dot(&u);
        // docs/method.md (1.3).
        let across = t - u * advance_m;
        let p = 0.5 * (across + u.cross(&across) / (0.5 * angle_rad).tan());
        Some(Self { direction, point: Point3::from(p - u * p.dot(&u)), angle_rad, advance_m })
    }

    /// The rigid motion of this screw.
    pub fn to_motion(&self) -> Pose {
        self.motion_by(self.angle_rad, self.advance_m)
    }

    /// The motion about the same line by other amounts.
    pub fn motion_by(&self, angle_rad: f64, advance_m: f64) -> Pose {
        let r = UnitQuaternion::from_axis_angle(&self.direction, angle_rad);
        // docs/method.md (1.4).
        let t = self.point.coords - r * self.point.coords + self.direction.into_inner() * advance_m;
        Pose::from_parts(Translation3::from(t), r)
    }
}

/// Two unit vectors normal to a third one, `unit`, and to each other; with it they are right-handed.
#[must_use]
pub fn normals_of(unit: &Vector3<f64>) -> [Vector3<f64>; 2] {
    // The axis least aligned with the vector keeps the cross product far from zero.
    let first = unit.cross(&Vector3::ith(unit.iamin(), 1.0)).normalize();
    [first, unit.cross(&first)]
}

/// How a joint moves its child along its axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AxisMotion {
    /// Rotation; positions in radians.
    Revolute,
    /// Translation; positions in meters.
    Prismatic,
    /// Rotation with proportional advance; positions in radians.
    Screw {
        /// Advance, meters per radian.
        pitch_m_per_rad: f64,
    },
}

impl AxisMotion {
    /// Name in files and reports.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Revolute => "revolute",
            Self::Prismatic => "prismatic",
            Self::Screw { .. } => "screw",
        }
    }

    /// Whether its position is an angle.
    pub fn is_turning(&self) -> bool {
        !matches!(self, Self::Prismatic)
    }

    /// Motion to a position about an axis through a point; the identity at 0.
    pub fn motion_to(&self, axis: Unit<Vector3<f64>>, point: Point3<f64>, position: f64) -> Pose {
        let line = Screw { direction: axis, point, angle_rad: 0.0, advance_m: 0.0 };
        match self {
            Self::Revolute => line.motion_by(position, 0.0),
            Self::Prismatic => line.motion_by(0.0, position),
            Self::Screw { pitch_m_per_rad } => line.motion_by(position, position * pitch_m_per_rad),
        }
    }
}

/// Rotation vector of a rotation: axis times angle in `[0, pi]`.
pub fn log_so3(rotation: &UnitQuaternion<f64>) -> Vector3<f64> {
    // Of the two quaternions of a rotation, takes the one with the smaller angle.
    let q = if rotation.w < 0.0 { -rotation.into_inner() } else { rotation.into_inner() };
    let v = q.imag();
    let s = v.norm();
    // Near the identity the sine equals its argument, and the quotient is not defined.
    if s < 1e-12 { 2.0 * v } else { v * (2.0 * s.atan2(q.w) / s) }
}

/// Translation, meters, and rotation vector, radians, of a motion.
pub fn shift_and_turn(motion: &Pose) -> Vector6<f64> {
    let shift = motion.translation.vector;
    let turn = log_so3(&motion.rotation);
    Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z)
}

/// Rotation with a given rotation vector.
pub fn exp_so3(rotation_vector: &Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(*rotation_vector)
}

/// Angle of a rotation in `[0, pi]`, radians.
pub fn rotation_angle_rad(rotation: &UnitQuaternion<f64>) -> f64 {
    log_so3(rotation).norm()
}

/// Shortest distance in meters between two lines, each a point and a unit direction. Parallel lines keep
/// their gap.
pub fn line_distance_m(
    point_a: &Point3<f64>,
    direction_a: &Vector3<f64>,
    point_b: &Point3<f64>,
    direction_b: &Vector3<f64>,
) -> f64 {
    let offset = point_b - point_a;
    let normal = direction_a.cross(direction_b);
    let sin = normal.norm();
    // For nearly parallel lines, numerator and denominator of the quotient are only rounding.
    if sin < PARALLEL_SIN { offset.cross(direction_a).norm() } else { offset.dot(&normal).abs() / sin }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn check(direction: [f64; 3], point: [f64; 3], angle_rad: f64, advance_m: f64) {
        let direction = Unit::new_normalize(Vector3::from(direction));
        let screw = Screw { direction, point: Point3::from(point), angle_rad, advance_m };
        let motion = screw.to_motion();
        let back = Screw::of_motion(&motion).unwrap();
        let again = back.to_motion();
        assert!((motion.translation.vector - again.translation.vector).norm() < 1e-7);
        assert!(motion.rotation.angle_to(&again.rotation) < 1e-7);
        assert!((back.angle_rad - angle_rad).abs() < 1e-7);
        assert!(line_distance_m(&screw.point, &direction, &back.point, &back.direction) < 1e-6);
        assert!(back.point.coords.dot(&back.direction).abs() < 1e-9);
    }

    proptest! {
        #[test]
        fn a_motion_gives_its_screw_back(
            d in prop::array::uniform3(-1.0..1.0f64),
            p in prop::array::uniform3(-2.0..2.0f64),
            angle in 0.01..3.1f64,
            advance in -0.5..0.5f64,
        ) {
            prop_assume!(Vector3::from(d).norm() > 0.1);
            check(d, p, angle, advance);
        }
    }

    #[test]
    fn half_a_turn_has_its_pivot() {
        check([0.0, 1.0, 1.0], [0.4, 0.1, -0.1], std::f64::consts::PI, 0.0);
    }

    #[test]
    fn a_translation_has_a_direction_and_no_angle() {
        let s = Screw::of_motion(&Pose::translation(0.0, 0.0, -0.2)).unwrap();
        assert_eq!(s.angle_rad, 0.0);
        assert!((s.advance_m - 0.2).abs() < 1e-12 && s.direction.z < -0.99);
        assert!(Screw::of_motion(&Pose::identity()).is_none());
    }

    #[test]
    fn parallel_lines_keep_their_gap() {
        let a = Point3::origin();
        let b = Point3::new(0.3, 0.0, 7.0);
        assert!((line_distance_m(&a, &Vector3::z(), &b, &-Vector3::z()) - 0.3).abs() < 1e-12);
        assert!((line_distance_m(&a, &Vector3::z(), &b, &Vector3::y()) - 0.3).abs() < 1e-12);
    }
}
