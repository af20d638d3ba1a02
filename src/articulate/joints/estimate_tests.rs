//! Joints of one and of several motions with a known answer.

use crate::joints::{drawn_residuals::DrawnResiduals, surface_draws::SurfaceDraws};
use nalgebra::{Matrix3, Point3, Unit, Vector3};

use super::*;
use crate::{MatchEvidence, MotionEvidence, ParentMotion, SeenDirection, SurfaceSamples};
use common::note::NoteCode;
use geometry::{Grid3, Pose, SceneBox, Screw, line_distance_m};

const HALF: Vector3<f64> = Vector3::new(0.2, 0.03, 0.15);

fn box_distance(p: &Point3<f64>) -> f64 {
    let q = p.coords.abs() - HALF;
    q.map(|x| x.max(0.0)).norm() + q.max().min(0.0)
}

fn box_samples(place: &Pose) -> SurfaceSamples {
    const N: usize = 12;
    let mut s = SurfaceSamples::default();
    for (axis, side, i) in
        (0..3).flat_map(|a| [-1.0, 1.0].into_iter().flat_map(move |s| (0..N * N).map(move |i| (a, s, i))))
    {
        let mut p = Vector3::zeros();
        p[axis] = side * HALF[axis];
        p[(axis + 1) % 3] = HALF[(axis + 1) % 3] * (2.0 * ((i % N) as f64 + 0.5) / N as f64 - 1.0);
        p[(axis + 2) % 3] = HALF[(axis + 2) % 3] * (2.0 * ((i / N) as f64 + 0.5) / N as f64 - 1.0);
        let mut normal = Vector3::zeros();
        normal[axis] = side;
        s.points.push(place * Point3::from(p));
        s.normals.push(place.rotation * normal);
        s.colors.push([0.5; 3]);
    }
    s
}

/// The joint of a box that makes some motions; the fits start off the truth, with so many matches.
fn joint_of(motions: &[Pose], matched: usize) -> JointEstimate {
    joint_by(motions, matched, &[])
}

/// The same where errors of poses and depth displace all states but state 0, by draw.
fn joint_by(motions: &[Pose], matched: usize, draws: &[Vector3<f32>]) -> JointEstimate {
    let place = Pose::translation(0.1, 0.05, 0.0);
    let scene = SceneBox::around_box(&Point3::new(-0.6, -0.6, -0.6), &Point3::new(0.6, 0.6, 0.6));
    let poses: Vec<Pose> = std::iter::once(place).chain(motions.iter().map(|m| m * place)).collect();
    let grid = |pose: &Pose| {
        let mut grid = Grid3::over_scene(&scene, 101, 0.0f32);
        (0..grid.values.len()).for_each(|i| {
            grid.values[i] = box_distance(&pose.inverse_transform_point(&grid.position_of_index(i))) as f32
        });
        grid
    };
    let sdf: Vec<Grid3<f32>> = poses.iter().map(grid).collect();
    let samples: Vec<SurfaceSamples> = poses.iter().map(box_samples).collect();
    let seen = Grid3::over_scene(&scene, 101, true);
    let still = ParentMotion::static_part();
    let off = Pose::new(Vector3::new(0.006, -0.005, 0.007), Vector3::new(0.01, 0.015, -0.01));
    let on_box = |m: &Pose| -> Vec<MatchEvidence> {
        let of = |p: &Point3<f64>| MatchEvidence {
            point0: *p,
            point1: m * p,
            covariance0: Matrix3::identity() * 4e-6,
            covariance1: Matrix3::identity() * 4e-6,
            share: 1.0,
        };
        samples[0].points[..matched].iter().map(of).collect()
    };
    let matches: Vec<Vec<MatchEvidence>> = motions.iter().map(on_box).collect();
    let drawn = |(k, m): (usize, &Pose)| {
        let of = |s: &SurfaceSamples, by: &[Vector3<f32>]| SurfaceDraws::alike(s.points.len(), by);
        let still = vec![Vector3::zeros(); draws.len()];
        let both = [of(&samples[0], &still), of(&samples[k + 1], draws)];
        let ends: Vec<[Point3<f64>; 2]> = matches[k].iter().map(|m| [m.point0, m.point1]).collect();
        DrawnResiduals::new(&both, [&samples[0], &samples[k + 1]], &ends, m, 0.05)
    };
    let drawn: Vec<DrawnResiduals> = motions.iter().enumerate().map(drawn).collect();
    let motion = |(k, m): (usize, &Pose)| JointMotion {
        start: off * m,
        parent: &still,
        evidence: MotionEvidence {
            surfaces: [&samples[0], &samples[k + 1]],
            sdf: [&sdf[0], &sdf[k + 1]],
            visible: [&seen, &seen],
            matches: &matches[k],
            independent_area_m2: 1e-3,
            areas_m2: [0.3, 0.3],
            reach_m: 0.05,
            block_m: 0.08,
            offsets_m: [&[]; 2],
            displacement_m: 0.0,
            patch_m: 0.2,
            drawn: &drawn[k],
        },
    };
    let all: Vec<JointMotion> = motions.iter().enumerate().map(motion).collect();
    let place = PartPlace { middle: Point3::new(0.1, 0.05, 0.0), radius_m: 0.25 };
    estimate_joint(&all, place, JointChoice { doubt: true, kind: None })
}

fn hinge(angle_rad: f64) -> Pose {
    Screw {
        direction: Unit::new_normalize(Vector3::new(0.1, 0.2, 1.0)),
        point: Point3::new(-0.1, 0.05, 0.0),
        angle_rad,
        advance_m: 0.0,
    }
    .to_motion()
}

/// Root of the sum of the variances of the axis direction, radians.
fn direction_std(joint: &JointEstimate) -> f64 {
    (0..3).map(|i| joint.evidence.covariance[(i, i)]).sum::<f64>().sqrt()
}

#[test]
fn all_positions_of_one_hinge_are_found() {
    let angles = [0.4, -0.3, 0.0];
    let joint = joint_of(&angles.map(hinge), 0);
    assert_eq!(joint.kind, JointKind::Revolute, "{:?}", joint.evidence.type_scores);
    assert!(joint.axis.angle(&Vector3::new(0.1, 0.2, 1.0)) < 4e-3);
    assert!(
        line_distance_m(
            &joint.point,
            &joint.axis,
            &Point3::new(-0.1, 0.05, 0.0),
            &Vector3::new(0.1, 0.2, 1.0)
        ) < 2e-3
    );
    for (found, truth) in joint.positions.iter().zip(angles) {
        assert!((found - truth).abs() < 2e-3, "{found} {truth}");
    }
    assert!((joint.largest_position() - 0.4).abs() < 2e-3);
    assert_eq!(joint.evidence.position_std.len(), 3);
}

#[test]
fn information_of_motions_adds() {
    let [one, two] = [vec![hinge(0.4)], vec![hinge(0.4), hinge(-0.4)]].map(|m| joint_of(&m, 0));
    let ratio = direction_std(&two) / direction_std(&one);
    // Two equal and independent motions: 1 / sqrt(2). State 0 is in both, whose errors do not average out.
    assert!((0.6..0.95).contains(&ratio), "{ratio}");
    // A motion that hardly turns says hardly anything about the axis.
    let small = direction_std(&joint_of(&[hinge(0.4), hinge(0.0)], 0)) / direction_std(&one);
    assert!(small > 0.9, "{small}");
}

#[test]
fn slides_to_both_sides_are_one_slide() {
    let along = Unit::new_normalize(Vector3::new(1.0, 0.2, 0.0));
    let slide =
        |m: f64| Pose::from_parts((along.into_inner() * m).into(), nalgebra::UnitQuaternion::identity());
    let joint = joint_of(&[slide(-0.05), slide(0.12)], 0);
    assert_eq!(joint.kind, JointKind::Prismatic, "{:?}", joint.evidence.type_scores);
    assert!(
        joint.axis.angle(&along) < 5e-3
            && (joint.positions[0] + 0.05).abs() < 1e-3
            && (joint.positions[1] - 0.12).abs() < 1e-3
    );
}

#[test]
fn a_motion_that_contradicts_the_others_is_left_out_with_a_caution() {
    let astray = Pose::new(Vector3::new(0.02, 0.03, 0.04), Vector3::new(0.2, -0.1, 0.05));
    let joint = joint_of(&[hinge(0.4), astray, hinge(-0.3)], 0);
    assert_eq!(joint.kind, JointKind::Revolute, "{:?}", joint.evidence.type_scores);
    assert!(joint.axis.angle(&Vector3::new(0.1, 0.2, 1.0)) < 4e-3);
    assert!(
        joint.evidence.cautions.iter().any(|c| matches!(c, JointRemark::StateContradicts { state: 2, .. })),
        "{:?}",
        joint.evidence.cautions
    );
    assert_eq!(joint.positions.len(), 3);
    assert!((joint.positions[2] + 0.3).abs() < 2e-3);
}

/// The joint of one motion, which it must be.
fn check(motion: &Pose, kind: JointKind) -> JointEstimate {
    let e = joint_of(&[*motion], 40);
    assert_eq!(e.kind, kind, "{:?}", e.evidence.type_scores);
    let difference = e.motions[0] * motion.inverse();
    assert!(difference.rotation.angle() < 2e-3, "{}", difference.rotation.angle());
    assert!((e.motions[0] * Point3::origin() - motion * Point3::origin()).norm() < 1e-3);
    e
}

#[test]
fn a_turned_box_is_revolute_about_its_line() {
    let axis = Unit::new_normalize(Vector3::new(0.1, 0.2, 1.0));
    let screw =
        Screw { direction: axis, point: Point3::new(-0.1, 0.05, 0.0), angle_rad: 0.6, advance_m: 0.0 };
    let e = check(&screw.to_motion(), JointKind::Revolute);
    assert!(e.axis.angle(&axis) < 4e-3, "{}", e.axis.angle(&axis));
    assert!(line_distance_m(&e.point, &e.axis, &screw.point, &axis) < 2e-3);
    assert!((e.largest_position() - 0.6).abs() < 2e-3);
}

#[test]
fn a_small_turn_is_no_slide() {
    let screw = Screw {
        direction: Vector3::z_axis(),
        point: Point3::new(-0.1, 0.05, 0.0),
        angle_rad: 0.1,
        advance_m: 0.0,
    };
    check(&screw.to_motion(), JointKind::Revolute);
}

#[test]
fn a_prior_moves_the_axis_and_what_goes_with_it() {
    let screw = Screw {
        direction: Vector3::z_axis(),
        point: Point3::new(-0.1, 0.05, 0.0),
        angle_rad: 0.3,
        advance_m: 0.0,
    };
    let e = check(&screw.to_motion(), JointKind::Revolute);
    let still = [ParentMotion::static_part()];
    let prior = |tilt: f64, std_rad: f64| {
        let direction = Unit::new_normalize(e.axis.into_inner() + Vector3::x() * tilt);
        SeenDirection { direction, covariance: Matrix3::identity() * std_rad.powi(2) }
    };
    let deviation = |e: &JointEstimate| e.evidence.covariance.fixed_view::<3, 3>(0, 0).trace().sqrt();
    // One that says nothing changes nothing.
    let vague = e.clone().with_axis_prior(&prior(0.03, 1e3), &still);
    assert!(vague.axis.angle(&e.axis) < 1e-6 && (deviation(&vague) / deviation(&e) - 1.0).abs() < 1e-6);
    assert!((vague.covariances[0] - e.covariances[0]).norm() < 1e-6 * e.covariances[0].norm());
    assert!(vague.evidence.axis_alone.is_some_and(|a| a.axis == e.axis && a.std_rad == deviation(&e)));
    // One that is known better is followed, and the motion is that of the joint.
    let firm = e.clone().with_axis_prior(&prior(0.03, 1e-5), &still);
    assert!(firm.axis.angle(&prior(0.03, 1.0).direction) < 1e-4 && deviation(&firm) < 3e-5);
    assert!(firm.covariances[0].trace() < e.covariances[0].trace());
    let by_joint =
        Screw { direction: firm.axis, point: firm.point, angle_rad: firm.largest_position(), advance_m: 0.0 }
            .to_motion();
    let middle = Point3::new(0.1, 0.05, 0.0);
    assert!((firm.motions[0] * by_joint.inverse()).rotation.angle() < 1e-9);
    assert!((by_joint * middle - screw.to_motion() * middle).norm() < 5e-4);
}

#[test]
fn a_slid_box_is_prismatic() {
    let e = check(&Pose::translation(0.12, 0.0, 0.02), JointKind::Prismatic);
    assert!((e.largest_position() - 0.12f64.hypot(0.02)).abs() < 1e-3);
    assert!(e.evidence.covariance[(6, 6)].sqrt() < 1e-3);
}

#[test]
fn an_advance_that_the_sensor_can_feign_is_no_screw() {
    let axis = Unit::new_normalize(Vector3::new(0.1, 0.2, 1.0));
    let advanced = |advance_m: f64| Screw { advance_m, ..Screw::of_motion(&hinge(0.6)).unwrap() }.to_motion();
    // Errors of 2 mm, root mean square, along the axis.
    let draws: Vec<Vector3<f32>> =
        (0..32).map(|d| (axis.into_inner() * (2e-3 * (f64::from(d) - 15.5) / 9.23)).cast()).collect();
    let kind = |advance_m: f64, draws: &[Vector3<f32>]| joint_by(&[advanced(advance_m)], 0, draws).kind;
    assert!(matches!(kind(2e-3, &[]), JointKind::Screw { .. }));
    assert_eq!(kind(2e-3, &draws), JointKind::Revolute);
    assert!(matches!(kind(0.02, &draws), JointKind::Screw { .. }));
    // What errors across the axis feign is another axis, no advance.
    let aside = axis.cross(&Vector3::x()).normalize();
    let across: Vec<Vector3<f32>> =
        draws.iter().map(|d| (aside * f64::from(d.dot(&axis.cast()))).cast()).collect();
    assert!(matches!(kind(2e-3, &across), JointKind::Screw { .. }));
}

#[test]
fn the_axis_points_to_where_the_farthest_motion_is_positive() {
    let joint = joint_of(&[hinge(0.2), hinge(-0.5)], 40);
    assert!(joint.axis.angle(&-Vector3::new(0.1, 0.2, 1.0)) < 4e-3);
    assert!((joint.positions[0] + 0.2).abs() < 2e-3 && (joint.positions[1] - 0.5).abs() < 2e-3);
    // What was observed of the farthest motion, and of both surfaces and all matches.
    let farthest = joint.evidence.state1_from_state0 * hinge(-0.5).inverse();
    assert!(farthest.translation.vector.norm() < 1e-3 && farthest.rotation.angle() < 2e-3, "{farthest}");
    let observations = 2 * (2 * 6 * 144 + 40);
    assert!(joint.evidence.tried <= observations && joint.evidence.tried > observations * 9 / 10);
    assert!(joint.evidence.inliers <= joint.evidence.tried);
    assert!(joint.evidence.inliers > joint.evidence.tried * 9 / 10, "{:?}", joint.evidence);
    assert!(joint.evidence.residual_rms_m > 0.0 && joint.evidence.residual_rms_m < 1e-3);
    assert_eq!(joint.evidence.pitch_std_m_per_rad, 0.0);
    // The line of the axis stands near the part's middle.
    let middle = Point3::new(0.1, 0.05, 0.0);
    assert!((middle - joint.point).dot(&joint.axis).abs() < 1e-9);
    // Each motion is that of the joint at its position.
    for (motion, position) in joint.motions.iter().zip(&joint.positions) {
        let by_joint =
            Screw { direction: joint.axis, point: joint.point, angle_rad: *position, advance_m: 0.0 };
        let off = motion * by_joint.to_motion().inverse();
        assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-9);
    }
}

#[test]
fn a_motion_left_out_has_the_position_next_to_it() {
    let astray = Pose::new(Vector3::new(0.02, 0.03, 0.04), Vector3::new(0.2, -0.1, 0.05));
    let joint = joint_of(&[hinge(0.4), astray, hinge(-0.3)], 0);
    let middle = Point3::new(0.1, 0.05, 0.0);
    let by_joint = |angle_rad: f64| {
        Screw { direction: joint.axis, point: joint.point, angle_rad, advance_m: 0.0 }.to_motion()
    };
    // The turn about the axis that comes next to the rotation.
    let nearest = astray.rotation.scaled_axis().dot(&joint.axis);
    assert!((joint.positions[1] - nearest).abs() < 2e-3, "{} {nearest}", joint.positions[1]);
    let off = joint.motions[1] * by_joint(joint.positions[1]).inverse();
    assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-9);
    assert_eq!(joint.evidence.position_std[1], f64::INFINITY);
    assert!(joint.evidence.position_std[0].is_finite() && joint.evidence.position_std[2].is_finite());
    assert_eq!((joint.covariances.len(), joint.drawn.len()), (3, 3));
    assert!(joint.covariances[1] == nalgebra::Matrix6::zeros() && joint.drawn[1].is_empty());
    // What it needs beyond the joint, in the coordinates of state 0.
    let off = by_joint(joint.positions[1]).inverse() * astray;
    let expected = [(off * middle - middle).norm(), off.rotation.angle()];
    let mut cautions = joint.evidence.cautions.iter();
    let said = cautions.find(|c| c.code() == NoteCode::StateContradicts).unwrap();
    let JointRemark::StateContradicts { state: 2, off_m, off_rad } = *said else { panic!("{said:?}") };
    assert!((off_m - expected[0]).abs() < 1e-3 && (off_rad - expected[1]).abs() < 0.005, "{said:?}");
}

#[test]
fn motions_that_all_contradict_each_other_are_all_kept() {
    let [first, second] = [
        Pose::new(Vector3::new(0.02, 0.03, 0.04), Vector3::new(0.2, -0.1, 0.05)),
        Pose::new(Vector3::new(-0.04, 0.01, 0.02), Vector3::new(-0.1, 0.3, 0.1)),
    ];
    let joint = joint_of(&[hinge(0.4), first, second, hinge(0.5).inverse() * first * second], 0);
    let cautions = &joint.evidence.cautions;
    assert!(cautions.iter().all(|c| c.code() != NoteCode::StateContradicts), "{cautions:?}");
    assert!(joint.evidence.position_std.iter().all(|s| s.is_finite()));
}

#[test]
fn a_screw_states_how_well_its_thread_is_known() {
    let threaded = Screw { advance_m: 0.03, ..Screw::of_motion(&hinge(0.6)).unwrap() }.to_motion();
    let joint = joint_of(&[threaded], 40);
    let JointKind::Screw { pitch_m_per_rad } = joint.kind else { panic!("{:?}", joint.kind) };
    assert!((pitch_m_per_rad - 0.05).abs() < 1e-3);
    let deviation = joint.evidence.pitch_std_m_per_rad;
    assert!(deviation > 0.0 && deviation < 1e-2, "{deviation}");
}

#[test]
fn one_motion_at_most_is_left_out() {
    let astray = Pose::new(Vector3::new(0.02, 0.03, 0.04), Vector3::new(0.2, -0.1, 0.05));
    // A millimeter across its axis: no joint explains it beside the others, and yet it is near them.
    let near = Pose::translation(0.001, 0.0, 0.0) * hinge(-0.3);
    let joint = joint_of(&[hinge(0.4), astray, near, hinge(0.2)], 0);
    let cautions = joint.evidence.cautions.iter();
    let said: Vec<_> = cautions.filter(|c| c.code() == NoteCode::StateContradicts).collect();
    assert!(matches!(said[..], [JointRemark::StateContradicts { state: 2, .. }]), "{said:?}");
    assert_eq!(joint.positions.len(), 4);
    assert!((joint.positions[3] - 0.2).abs() < 0.01 && (joint.positions[2] + 0.3).abs() < 0.02);
}
