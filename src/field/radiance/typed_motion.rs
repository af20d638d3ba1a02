//! Conversion of free half motions to those of typed joints, and to whole motions in the world.

use nalgebra::{Point3, Unit};

use super::HalfMotion;
use geometry::{Pose, SceneBox, Screw, rotation_angle_rad};

/// Least rotation of a half motion for a revolute joint, radians; below it is prismatic.
///
/// derived: the published rule, 5 degrees (Liu, Mahdavi-Amiri and Savva 2023)
const LEAST_HALF_TURN_RAD: f64 = 5.0 * std::f64::consts::PI / 180.0;

impl HalfMotion {
    /// The joint that fits this motion: a rotation about its axis, without its translation along the axis;
    /// or, if it rotates by less than 5 degrees, its translation without the rotation.
    #[must_use]
    pub fn typed_joint(&self) -> Self {
        let Self::Free { pose } = self else { return *self };
        if rotation_angle_rad(&pose.rotation) >= LEAST_HALF_TURN_RAD {
            let pivot = Screw::of_motion(pose).map_or_else(Point3::origin, |s| s.point);
            return Self::Revolute { pivot, rotation: pose.rotation };
        }
        // Without a translation there is no direction; the published start is used.
        Unit::try_new_and_get(pose.translation.vector, 1e-9).map_or_else(
            Self::prismatic_start,
            |(direction, distance)| Self::Prismatic { direction, distance },
        )
    }

    /// Half of a motion in the world, meters, which must rotate by less than half a turn.
    pub fn of_world(state1_from_state0: &Pose, scene: &SceneBox) -> Self {
        Self::of_whole(&scene.normalised_motion(state1_from_state0))
    }

    /// The whole motion in the world, meters: the half motion applied twice.
    pub fn state1_from_state0(&self, scene: &SceneBox) -> Pose {
        let half = self.pose();
        scene.world_motion(&(half * half))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;
    use geometry::line_distance_m;

    fn scene() -> SceneBox {
        SceneBox { center: Point3::new(0.2, -0.1, 0.4), scale: 2.5 }
    }

    fn turn(half_rad: f64) -> HalfMotion {
        HalfMotion::Free { pose: Pose::new(Vector3::new(0.1, 0.05, 0.0), Vector3::z() * half_rad) }
    }

    #[test]
    fn a_half_turn_of_five_degrees_parts_turns_from_shifts() {
        assert!(matches!(turn(4.99f64.to_radians()).typed_joint(), HalfMotion::Prismatic { .. }));
        assert!(matches!(turn(5.01f64.to_radians()).typed_joint(), HalfMotion::Revolute { .. }));
        // A typed joint keeps its type.
        let rotation = UnitQuaternion::new(Vector3::z() * 0.01);
        let small = HalfMotion::Revolute { pivot: Point3::origin(), rotation };
        assert_eq!(small.typed_joint(), small);
    }

    #[test]
    fn the_whole_turn_has_twice_the_angle_about_the_same_line() {
        let axis = Unit::new_normalize(Vector3::new(1.0, 2.0, -0.5));
        let pivot = Point3::new(0.3, -0.2, 0.1);
        let half = HalfMotion::Revolute { pivot, rotation: UnitQuaternion::from_axis_angle(&axis, 0.35) };
        let whole = half.state1_from_state0(&scene());
        let screw = Screw::of_motion(&whole).unwrap();
        assert!((screw.angle_rad - 0.7).abs() < 1e-9 && screw.direction.dot(&axis) > 1.0 - 1e-12);
        let world = scene().to_world(&pivot);
        assert!(line_distance_m(&screw.point, &screw.direction, &world, &axis) < 1e-9);
        // A point taken along in the world and in normalised coordinates.
        let x = Point3::new(0.5, 0.1, 0.2);
        let there = scene().to_world(&(half.pose() * (half.pose() * scene().normalise(&x))));
        assert!((whole * x - there).norm() < 1e-12);
        let back = HalfMotion::of_world(&whole, &scene()).pose();
        assert!((back.inverse() * half.pose()).to_homogeneous().relative_eq(
            &nalgebra::Matrix4::identity(),
            1e-9,
            1e-9
        ));
    }

    #[test]
    fn the_whole_shift_has_twice_the_length() {
        let whole = HalfMotion::prismatic_start().state1_from_state0(&scene());
        let shift = whole.translation.vector;
        assert!((shift.norm() - 0.2 / 2.5).abs() < 1e-12 && whole.rotation.angle() == 0.0);
        assert!((shift.x - shift.z).abs() < 1e-12 && shift.x > 0.0);
    }

    #[test]
    fn typed_joints_start_from_what_was_found() {
        let found = turn(0.4);
        let typed = found.typed_joint();
        assert!((typed.pose().inverse() * found.pose()).translation.vector.norm() < 1e-9);
        let slid = turn(0.01);
        let HalfMotion::Prismatic { direction, distance } = slid.typed_joint() else { panic!("a turn") };
        assert!((direction.into_inner() * distance - Vector3::new(0.1, 0.05, 0.0)).norm() < 1e-12);
    }
}
