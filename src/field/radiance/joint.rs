//! From half motions to joints.

use nalgebra::{Point3, Unit, Vector3};
use serde::{Deserialize, Serialize};

use super::HalfMotion;
use crate::geometry::{Pose, SceneBox, Screw, rotation_angle_rad};

/// A half motion that turns by less is a shift, radians (derived: the published rule, 5 degrees).
const SHIFT_BELOW_RAD: f64 = 5.0 * std::f64::consts::PI / 180.0;

/// What a joint does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MotionKind {
    /// Turns about a line.
    Revolute,
    /// Slides along a direction.
    Prismatic,
}

/// The whole motion of a part from state 0 to state 1, in the world.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointEstimate {
    /// What the joint does.
    pub kind: MotionKind,
    /// The whole motion as it was found, meters.
    pub state1_from_state0: Pose,
    /// Unit direction of the axis, of which turn or shift are positive.
    pub axis: Unit<Vector3<f64>>,
    /// The point of a turn's axis nearest the world's origin, meters; the origin for a shift.
    pub pivot: Point3<f64>,
    /// Angle of a turn, radians; 0 for a shift.
    pub angle_rad: f64,
    /// Distance of a shift, meters; 0 for a turn.
    pub distance_m: f64,
}

impl HalfMotion {
    /// What the joint does: as its form says; a free motion slides if half of it turns by less than 5
    /// degrees (the rule of Liu, Mahdavi-Amiri and Savva 2023).
    #[must_use]
    pub fn kind(&self) -> MotionKind {
        let turn_rad = match self {
            Self::Free { pose } => rotation_angle_rad(&pose.rotation),
            Self::Revolute { .. } => std::f64::consts::PI,
            Self::Prismatic { .. } => 0.0,
        };
        if turn_rad < SHIFT_BELOW_RAD { MotionKind::Prismatic } else { MotionKind::Revolute }
    }

    /// The joint that starts where this motion is: a turn about its axis (its shift along the axis is
    /// dropped), or the shift by its translation (its turn is dropped).
    #[must_use]
    pub fn typed(&self) -> Self {
        let pose = self.pose();
        match self.kind() {
            MotionKind::Revolute => {
                let pivot = Screw::of(&pose).map_or_else(Point3::origin, |s| s.point);
                Self::Revolute { pivot, rotation: pose.rotation }
            }
            MotionKind::Prismatic => {
                let t = pose.translation.vector;
                // No shift has no direction: then the published start.
                Unit::try_new_and_get(t, 1e-9).map_or_else(Self::prismatic, |(direction, distance)| {
                    Self::Prismatic { direction, distance }
                })
            }
        }
    }

    /// The whole motion in the world: twice the half, by the angle `2 theta` about the pivot nearest the
    /// origin, or by the distance `2 |t|`.
    #[must_use]
    pub fn joint(&self, scene: &SceneBox) -> JointEstimate {
        let half = self.pose();
        let state1_from_state0 = in_world(&(half * half), scene);
        let shift = state1_from_state0.translation.vector;
        let screw = Screw::of(&state1_from_state0);
        let kind = self.kind();
        match (kind, screw) {
            (MotionKind::Revolute, Some(s)) => JointEstimate {
                kind,
                state1_from_state0,
                axis: s.direction,
                pivot: s.point,
                angle_rad: s.angle_rad,
                distance_m: 0.0,
            },
            _ => JointEstimate {
                kind,
                state1_from_state0,
                axis: Unit::try_new(shift, 0.0).unwrap_or_else(Vector3::z_axis),
                pivot: Point3::origin(),
                angle_rad: 0.0,
                distance_m: shift.norm(),
            },
        }
    }
}

/// A motion of normalised coordinates in the world, meters.
pub(super) fn in_world(normalised: &Pose, scene: &SceneBox) -> Pose {
    // x_n = s (x - c), y_n = R x_n + t  =>  y = R x + c - R c + t / s.
    let c = scene.center.coords;
    let t = c - normalised.rotation * c + normalised.translation.vector / scene.scale;
    Pose::from_parts(t.into(), normalised.rotation)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{exp_so3, line_distance_m};

    fn scene() -> SceneBox {
        SceneBox { center: Point3::new(0.2, -0.1, 0.4), scale: 2.5 }
    }

    fn turn(half_rad: f64) -> HalfMotion {
        HalfMotion::Free { pose: Pose::new(Vector3::new(0.1, 0.05, 0.0), Vector3::z() * half_rad) }
    }

    #[test]
    fn a_half_turn_of_five_degrees_parts_turns_from_shifts() {
        assert_eq!(turn(4.99f64.to_radians()).kind(), MotionKind::Prismatic);
        assert_eq!(turn(5.01f64.to_radians()).kind(), MotionKind::Revolute);
        // A typed joint keeps its type.
        let small = HalfMotion::Revolute { pivot: Point3::origin(), rotation: exp_so3(&Vector3::z()) };
        assert_eq!(small.kind(), MotionKind::Revolute);
        assert_eq!(HalfMotion::prismatic().kind(), MotionKind::Prismatic);
    }

    #[test]
    fn the_whole_turn_has_twice_the_angle_about_the_same_line() {
        let axis = Unit::new_normalize(Vector3::new(1.0, 2.0, -0.5));
        let pivot = Point3::new(0.3, -0.2, 0.1);
        let rotation = UnitQuaternionOf::from_axis_angle(&axis, 0.35);
        let joint = HalfMotion::Revolute { pivot, rotation }.joint(&scene());
        assert_eq!(joint.kind, MotionKind::Revolute);
        assert!((joint.angle_rad - 0.7).abs() < 1e-9 && joint.axis.dot(&axis) > 1.0 - 1e-12);
        let world = scene().world(&pivot);
        assert!(line_distance_m((&joint.pivot, &joint.axis), (&world, &axis)) < 1e-9);
        assert!(joint.pivot.coords.dot(&joint.axis).abs() < 1e-9, "nearest the origin");
        // A point taken along in the world and in normalised coordinates.
        let x = Point3::new(0.5, 0.1, 0.2);
        let half = HalfMotion::Revolute { pivot, rotation }.pose();
        let there = scene().world(&(half * (half * scene().normalise(&x))));
        assert!((joint.state1_from_state0 * x - there).norm() < 1e-12);
    }

    #[test]
    fn the_whole_shift_has_twice_the_length() {
        let joint = HalfMotion::prismatic().joint(&scene());
        assert!((joint.distance_m - 0.2 / 2.5).abs() < 1e-12 && joint.angle_rad == 0.0);
        assert!((joint.axis.x - joint.axis.z).abs() < 1e-12 && joint.axis.x > 0.5);
    }

    #[test]
    fn typed_joints_start_from_what_was_found() {
        let found = turn(0.4);
        let typed = found.typed();
        assert!((typed.pose().inverse() * found.pose()).translation.vector.norm() < 1e-9);
        let slid = turn(0.01);
        let HalfMotion::Prismatic { direction, distance } = slid.typed() else { panic!("a turn") };
        assert!((direction.into_inner() * distance - Vector3::new(0.1, 0.05, 0.0)).norm() < 1e-12);
    }

    type UnitQuaternionOf = nalgebra::UnitQuaternion<f64>;
}
