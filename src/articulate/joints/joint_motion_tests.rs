//! Motions of joints against their geometry.

use nalgebra::{Matrix3, Vector6};

use super::*;

fn direction() -> Unit<Vector3<f64>> {
    Unit::new_normalize(Vector3::new(0.3, -0.4, 0.8))
}

fn joint(freedom: Freedom) -> PlacedJoint {
    PlacedJoint {
        freedom,
        direction: direction(),
        point: Point3::new(0.2, 0.1, -0.3),
        pitch_m_per_rad: if freedom == Freedom::Helix { 0.05 } else { 0.0 },
        positions: vec![0.4, -0.7],
    }
}

const ALL: [Freedom; 3] = [Freedom::Slide, Freedom::Turn, Freedom::Helix];

fn distance_m(a: &Pose, b: &Pose) -> f64 {
    (a.to_homogeneous() - b.to_homogeneous()).amax()
}

#[test]
fn a_joint_moves_along_and_about_its_axis() {
    let point = Point3::new(0.2, 0.1, -0.3);
    let beside = point + direction().cross(&Vector3::x());
    for (freedom, angle_rad, advance_m) in
        [(Freedom::Slide, 0.0, 0.6), (Freedom::Turn, 0.6, 0.0), (Freedom::Helix, 0.6, 0.03)]
    {
        let motion = joint(freedom).motion_at(0.6);
        // The axis stays on itself; what is beside it turns by the angle.
        let along = direction().into_inner() * advance_m;
        assert!((motion * point - (point + along)).norm() < 1e-12, "{freedom:?}");
        assert!((motion * direction().into_inner() - direction().into_inner()).norm() < 1e-12);
        assert!((motion.rotation.angle() - angle_rad).abs() < 1e-12, "{freedom:?}");
        let turned = (motion * beside - point - along).dot(&(beside - point).cross(&direction()));
        assert!(if angle_rad > 0.0 { turned < -0.1 } else { turned.abs() < 1e-12 }, "{freedom:?} {turned}");
    }
    let families = ALL.map(Freedom::family);
    assert_eq!(families, [JointFamily::Prismatic, JointFamily::Revolute, JointFamily::Screw]);
}

#[test]
fn a_motion_on_a_parent_follows_the_parent() {
    let parent = Pose::new(Vector3::new(0.1, 0.2, 0.3), Vector3::new(0.2, 0.1, -0.4));
    for joint in ALL.map(joint) {
        for (k, position) in [0.4, -0.7].into_iter().enumerate() {
            assert!(
                distance_m(&joint.world_motion(k, &parent), &(parent * joint.motion_at(position))) < 1e-12
            );
            assert!(distance_m(&joint.world_motion(k, &parent), &joint.motion_at(position)) > 0.1);
        }
    }
}

#[test]
fn the_nearest_position_is_that_of_the_motion() {
    let near = Point3::new(0.5, -0.2, 0.1);
    for joint in ALL.map(joint) {
        for position in [0.6, -0.3] {
            assert!((joint.nearest_position(&joint.motion_at(position), &near) - position).abs() < 1e-12);
        }
    }
    // A slide takes what the part's middle moves along it, whatever turns there.
    let turn = Pose::rotation(Vector3::new(0.1, 0.2, 0.3));
    let about =
        Pose::translation(near.x, near.y, near.z) * turn * Pose::translation(-near.x, -near.y, -near.z);
    let moved =
        Pose::from_parts((direction().into_inner() * 0.25).into(), nalgebra::UnitQuaternion::identity());
    assert!((joint(Freedom::Slide).nearest_position(&(moved * about), &near) - 0.25).abs() < 1e-12);
}

#[test]
fn fits_start_from_the_screw_of_a_motion() {
    let near = Point3::new(0.5, -0.2, 0.1);
    let motion = |angle_rad: f64, advance_m: f64| {
        Screw { direction: direction(), point: Point3::new(0.2, 0.1, -0.3), angle_rad, advance_m }.to_motion()
    };
    let slide = PlacedJoint::slide(&motion(0.0, 0.2), &near);
    assert!(slide.freedom == Freedom::Slide && slide.direction.angle(&direction()) < 1e-9);
    assert!(slide.point == near && slide.positions.is_empty() && slide.pitch_m_per_rad == 0.0);
    // Towards where the part's middle went.
    let turned = motion(0.5, 0.0);
    assert!(PlacedJoint::slide(&turned, &near).direction.angle(&(turned * near - near)) < 1e-9);
    assert_eq!(PlacedJoint::slide(&Pose::identity(), &near).direction, Vector3::x_axis());
    for angle_rad in [0.5, 0.0011] {
        let turn = PlacedJoint::turn(&motion(angle_rad, 0.02), &near).unwrap();
        assert!(turn.freedom == Freedom::Turn && turn.direction.angle(&direction()) < 1e-6);
        let foot = foot_on_line(&Point3::new(0.2, 0.1, -0.3), &direction(), &near);
        assert!((turn.point - foot).norm() < 1e-6, "{} {foot}", turn.point);
        assert!(turn.pitch_m_per_rad == 0.0 && turn.positions.is_empty());
        let helix = PlacedJoint::helix(&motion(angle_rad, 0.02), &near).unwrap();
        assert!(helix.freedom == Freedom::Helix && helix.direction == turn.direction);
        assert!((helix.pitch_m_per_rad * angle_rad / 0.02 - 1.0).abs() < 1e-6);
    }
    // Below a thousandth of a radian there is no axis.
    assert!(PlacedJoint::turn(&motion(0.0009, 0.02), &near).is_none());
    assert!(PlacedJoint::helix(&motion(0.0009, 0.02), &near).is_none());
}

#[test]
fn a_step_moves_axis_pitch_and_positions() {
    for joint in ALL.map(joint) {
        let axis = match joint.freedom {
            Freedom::Slide => 2,
            Freedom::Turn => 4,
            Freedom::Helix => 5,
        };
        assert_eq!((joint.axis_dimension(), joint.dimension()), (axis, axis + 2));
        let mut step = DVector::from_fn(axis + 2, |i, _| 0.01 * (i + 1) as f64);
        let next = joint.stepped(&step);
        let (a, b) = frame_across(&joint.direction);
        let turned = Unit::new_normalize(joint.direction.into_inner() + a * 0.01 + b * 0.02);
        assert!(next.direction.angle(&turned) < 1e-9);
        let shifted = if axis == 2 { Vector3::zeros() } else { a * 0.03 + b * 0.04 };
        assert!((next.point - joint.point - shifted).norm() < 1e-12);
        let threaded = if axis == 5 { 0.05 } else { 0.0 };
        assert!((next.pitch_m_per_rad - joint.pitch_m_per_rad - threaded).abs() < 1e-12);
        for k in 0..2 {
            let by = 0.01 * (axis + k + 1) as f64;
            assert!((next.positions[k] - joint.positions[k] - by).abs() < 1e-12);
        }
        step.fill(0.0);
        assert!(joint.stepped(&step).point == joint.point);
    }
}

#[test]
fn tangents_are_the_twists_of_the_parameters() {
    let parent = Pose::new(Vector3::new(0.1, 0.2, 0.3), Vector3::new(0.2, 0.1, -0.4));
    let turn_of = |rotation: &nalgebra::UnitQuaternion<f64>| *rotation.to_rotation_matrix().matrix();
    let turned = turn_of(&parent.rotation);
    for joint in ALL.map(joint) {
        let k = 1;
        let first = joint.axis_dimension();
        let tangent = joint.motion_tangent(k, &parent);
        assert_eq!((tangent.nrows(), tangent.ncols()), (6, joint.dimension()));
        let column = |i: usize| Vector6::from_fn(|r, _| tangent[(r, i)]);
        let is_near = |i: usize, v: Vector3<f64>, w: Vector3<f64>| {
            let expected = Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z);
            assert!((column(i) - expected).amax() < 3e-6, "{:?} {i}: {}", joint.freedom, column(i));
        };
        // A motion shifts by v and turns by w about the world's origin. Differences over a finite step, whose
        // half is a millionth, are off by as much.
        let axis = turned * joint.direction.into_inner();
        let at_axis = (parent * joint.point).coords.cross(&axis);
        let nothing = Vector3::zeros();
        match joint.freedom {
            Freedom::Slide => is_near(first + k, axis, nothing),
            Freedom::Turn => is_near(first + k, at_axis, axis),
            Freedom::Helix => is_near(first + k, at_axis + axis * 0.05, axis),
        }
        is_near(first, nothing, nothing);
        if joint.freedom != Freedom::Slide {
            // c + R (x - c) moves by c' - R c'.
            let rest = Matrix3::identity() - turn_of(&joint.motion_at(joint.positions[k]).rotation);
            let (a, b) = frame_across(&joint.direction);
            is_near(2, turned * rest * a, nothing);
            is_near(3, turned * rest * b, nothing);
        } else {
            let (a, b) = frame_across(&joint.direction);
            is_near(0, turned * a * joint.positions[k], nothing);
            is_near(1, turned * b * joint.positions[k], nothing);
        }
        if joint.freedom == Freedom::Helix {
            is_near(4, axis * joint.positions[k], nothing);
        }
    }
}

#[test]
fn the_frame_across_is_right_handed_for_every_direction() {
    let oblique = [[0.59, 0.7, 0.1], [0.61, 0.3, -0.2], [-0.61, 0.2, 0.6], [-0.3, -0.9, 0.2]];
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]];
    for d in oblique.into_iter().chain(axes) {
        let direction = Unit::new_normalize(Vector3::from(d));
        let (a, b) = frame_across(&direction);
        let frame = Matrix3::from_columns(&[a, b, direction.into_inner()]);
        assert!((frame * frame.transpose() - Matrix3::identity()).amax() < 1e-12, "{direction:?}");
        assert!((frame.determinant() - 1.0).abs() < 1e-12, "{direction:?}");
    }
}

#[test]
fn the_foot_is_the_nearest_point_of_a_line() {
    let point = Point3::new(0.2, 0.1, -0.3);
    let near = Point3::new(0.5, -0.2, 0.1);
    let foot = foot_on_line(&point, &direction(), &near);
    assert!((foot - point).cross(&direction()).norm() < 1e-12);
    assert!((near - foot).dot(&direction()).abs() < 1e-12 && (foot - point).norm() > 0.1);
}
