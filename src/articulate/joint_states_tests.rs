//! Joints of several motions with a known answer.

use super::*;
use crate::{
    articulate::SurfaceSamples,
    geometry::{Grid3, SceneBox, line_distance_m},
};

const HALF: Vector3<f64> = Vector3::new(0.2, 0.03, 0.15);

fn box_distance(p: &Point3<f64>) -> f64 {
    let q = p.coords.abs() - HALF;
    q.map(|x| x.max(0.0)).norm() + q.max().min(0.0)
}

fn box_samples(place: &Pose) -> SurfaceSamples {
    const N: usize = 12;
    let mut s = SurfaceSamples::default();
    for (axis, side, i) in (0..3).flat_map(|a| [-1.0, 1.0].into_iter().flat_map(move |s| (0..N * N).map(move |i| (a, s, i)))) {
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

/// The joint of a box that makes some motions; the fits start off the truth.
fn joint_of(motions: &[Pose], doubt: bool) -> JointEstimate {
    let place = Pose::translation(0.1, 0.05, 0.0);
    let scene = SceneBox::around(&Point3::new(-0.6, -0.6, -0.6), &Point3::new(0.6, 0.6, 0.6));
    let poses: Vec<Pose> = std::iter::once(place).chain(motions.iter().map(|m| m * place)).collect();
    let grid = |pose: &Pose| {
        let mut grid = Grid3::over(&scene, 101, 0.0f32);
        (0..grid.values.len()).for_each(|i| grid.values[i] = box_distance(&pose.inverse_transform_point(&grid.position(i))) as f32);
        grid
    };
    let sdf: Vec<Grid3<f32>> = poses.iter().map(grid).collect();
    let samples: Vec<SurfaceSamples> = poses.iter().map(box_samples).collect();
    let seen = Grid3::over(&scene, 101, true);
    let still = ParentMotion::still();
    let off = Pose::new(Vector3::new(0.006, -0.005, 0.007), Vector3::new(0.01, 0.015, -0.01));
    let motion = |(k, m): (usize, &Pose)| JointMotion {
        start: off * m,
        parent: &still,
        evidence: MotionEvidence {
            surfaces: [&samples[0], &samples[k + 1]],
            sdf: [&sdf[0], &sdf[k + 1]],
            visible: [&seen, &seen],
            matches: &[],
            independent_area_m2: 1e-3,
            areas_m2: [0.3, 0.3],
            reach_m: 0.05,
            block_m: 0.08,
            offsets_m: [&[]; 2],
            displacement_m: 0.0,
            piece_m: 0.2,
        },
    };
    let all: Vec<JointMotion> = motions.iter().enumerate().map(motion).collect();
    estimate_shared_joint(&all, (&Point3::new(0.1, 0.05, 0.0), 0.25), doubt, None, &RefineConfig::default())
}

fn hinge(angle_rad: f64) -> Pose {
    Screw { direction: Unit::new_normalize(Vector3::new(0.1, 0.2, 1.0)), point: Point3::new(-0.1, 0.05, 0.0), angle_rad, advance_m: 0.0 }
        .motion()
}

/// Root of the sum of the variances of the axis direction, radians.
fn direction_std(joint: &JointEstimate) -> f64 {
    (0..3).map(|i| joint.evidence.covariance[(i, i)]).sum::<f64>().sqrt()
}

#[test]
fn all_positions_of_one_hinge_are_found() {
    let angles = [0.4, -0.3, 0.0];
    let joint = joint_of(&angles.map(hinge), true);
    assert_eq!(joint.kind, JointKind::Revolute, "{:?}", joint.evidence.type_scores);
    assert!(joint.axis.angle(&Vector3::new(0.1, 0.2, 1.0)) < 4e-3);
    assert!(line_distance_m((&joint.point, &joint.axis), (&Point3::new(-0.1, 0.05, 0.0), &Vector3::new(0.1, 0.2, 1.0))) < 2e-3);
    for (found, truth) in joint.positions.iter().zip(angles) {
        assert!((found - truth).abs() < 2e-3, "{found} {truth}");
    }
    assert!((joint.motion() - 0.4).abs() < 2e-3);
    assert_eq!(joint.evidence.position_std.len(), 3);
}

#[test]
fn information_of_motions_adds() {
    let [one, two] = [vec![hinge(0.4)], vec![hinge(0.4), hinge(-0.4)]].map(|m| joint_of(&m, true));
    let ratio = direction_std(&two) / direction_std(&one);
    // Two equal and independent motions: 1 / sqrt(2). State 0 is in both, whose errors do not average out.
    assert!((0.6..0.95).contains(&ratio), "{ratio}");
    // A motion that hardly turns tells hardly anything of the axis.
    let small = direction_std(&joint_of(&[hinge(0.4), hinge(0.0)], true)) / direction_std(&one);
    assert!(small > 0.9, "{small}");
}

#[test]
fn slides_to_both_sides_are_one_slide() {
    let along = Unit::new_normalize(Vector3::new(1.0, 0.2, 0.0));
    let slide = |m: f64| Pose::from_parts((along.into_inner() * m).into(), nalgebra::UnitQuaternion::identity());
    let joint = joint_of(&[slide(-0.05), slide(0.12)], true);
    assert_eq!(joint.kind, JointKind::Prismatic, "{:?}", joint.evidence.type_scores);
    assert!(joint.axis.angle(&along) < 5e-3 && (joint.positions[0] + 0.05).abs() < 1e-3 && (joint.positions[1] - 0.12).abs() < 1e-3);
}

#[test]
fn a_motion_that_contradicts_the_others_is_left_out_and_told() {
    let astray = Pose::new(Vector3::new(0.02, 0.03, 0.04), Vector3::new(0.2, -0.1, 0.05));
    let joint = joint_of(&[hinge(0.4), astray, hinge(-0.3)], true);
    assert_eq!(joint.kind, JointKind::Revolute, "{:?}", joint.evidence.type_scores);
    assert!(joint.axis.angle(&Vector3::new(0.1, 0.2, 1.0)) < 4e-3);
    assert!(joint.evidence.cautions.iter().any(|c| c.contains("state 2 contradicts")), "{:?}", joint.evidence.cautions);
    assert_eq!(joint.positions.len(), 3);
    assert!((joint.positions[2] + 0.3).abs() < 2e-3);
}
