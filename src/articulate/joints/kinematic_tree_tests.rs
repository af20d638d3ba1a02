//! The tree and the joints of scenes with a known answer.

use crate::joints::surface_draws::SurfaceDraws;
use nalgebra::{Point3, Vector3};

use super::*;
use crate::{
    joints::pair_evidence::PairEvidence,
    samples::synthetic::{Scene, camera_ring},
};
use capture::NoiseConfig;
use geometry::{Grid3, Pose, SceneBox, Screw, line_distance_m};

const NODES: usize = 121;

/// Parents and joints of a scene whose labels and motions are known but for a few millimeters.
fn tree_of(scene: &Scene) -> Vec<TreeJointEstimate> {
    let cameras = camera_ring(10);
    let observed = [0, 1].map(|s| scene.surface(s, &cameras, 0.005));
    let around = SceneBox::around_box(&Point3::new(-0.35, -0.35, -0.1), &Point3::new(0.35, 0.35, 0.6));
    let sdf = [0, 1].map(|s| {
        let mut grid = Grid3::over_scene(&around, NODES, 0.0f32);
        (0..grid.values.len())
            .for_each(|i| grid.values[i] = scene.distance_m(s, &grid.position_of_index(i)) as f32);
        grid
    });
    let seen = Grid3::over_scene(&around, NODES, true);
    let none = SurfaceDraws::default();
    let states = [0, 1].map(|s| ObservedState {
        frames: &[],
        samples: &observed[s].0,
        labels: &observed[s].1,
        sdf: &sdf[s],
        visible: &seen,
        area_m2: 25e-6 * observed[s].1.len() as f64,
        draws: &none,
    });
    let off = Pose::new(Vector3::new(0.001, -0.0008, 0.0012), Vector3::new(0.004, 0.003, -0.004));
    let config = JointConfig::default();
    let noise = NoiseConfig::default();
    let extent_m = 0.5;
    let gather =
        |k: usize| PairEvidence::gather(k as u8, &(off * scene.truth(k)), states, &[], &noise, extent_m);
    let parts: Vec<PartEvidence> =
        (1..scene.parts.len()).filter_map(|k| PartEvidence::new([gather(k)])).collect();
    kinematic_tree(&[ParentMotion::static_part()], &parts, &states, extent_m, &config)
}

/// Distance of a joint's axis from the line through a point along a direction, meters.
fn line_error_m(joint: &JointEstimate, point: [f64; 3], direction: Vector3<f64>) -> f64 {
    line_distance_m(&joint.point, &joint.axis, &Point3::from(point), &direction)
}

#[test]
fn a_lamp_is_a_chain_although_its_axes_are_parallel() {
    let found = tree_of(&Scene::lamp());
    assert_eq!(found.iter().map(|t| t.parent).collect::<Vec<_>>(), [0, 1]);
    for (t, at) in found.iter().zip([[0.0, 0.0, 0.05], [0.0, 0.0, 0.33]]) {
        assert_eq!(t.joint.kind, JointKind::Revolute, "{:?}", t.joint.evidence.type_scores);
        assert!(t.joint.axis.cross(&Vector3::y()).norm() < 0.01, "{:?}", t.joint.axis);
        assert!(
            line_error_m(&t.joint, at, Vector3::y()) < 0.002,
            "{}",
            line_error_m(&t.joint, at, Vector3::y())
        );
    }
    assert!(
        (found[0].joint.largest_position() - 0.5).abs() < 0.01
            && (found[1].joint.largest_position() - 0.6).abs() < 0.01
    );
    // The carried motion is that of both joints.
    let apart = found[1].joint.motions[0] * Scene::lamp().truth(2).inverse();
    assert!(apart.rotation.angle() < 0.01 && found[1].joint.evidence.parents.len() == 2);
    // Turns about parallel axes make one turn against the base, too.
    let said = &found[1].joint.evidence.not_observable;
    assert!(said.iter().any(|s| matches!(s, JointRemark::StaticAsSimple { link: 0, .. })), "{said:?}");
}

#[test]
fn a_lid_and_a_drawer_both_hang_on_the_box() {
    let found = tree_of(&Scene::box_with_lid_and_drawer());
    assert_eq!(found.iter().map(|t| t.parent).collect::<Vec<_>>(), [0, 0]);
    assert_eq!(found[0].joint.kind, JointKind::Revolute);
    assert_eq!(found[1].joint.kind, JointKind::Prismatic);
}

#[test]
fn an_unscrewed_lid_has_its_pitch() {
    let found = tree_of(&Scene::jar());
    let JointKind::Screw { pitch_m_per_rad } = found[0].joint.kind else {
        panic!("{:?}", found[0].joint.evidence.type_scores)
    };
    // The axis points to where the motion is positive, so that the pitch keeps its sign.
    assert!((pitch_m_per_rad - 0.008).abs() < 0.0003, "{pitch_m_per_rad}");
    assert!(found[0].joint.evidence.pitch_std_m_per_rad > 0.0);
    assert!(line_error_m(&found[0].joint, [0.0; 3], Vector3::z()) < 0.002);
    let truth = Screw::of_motion(&Scene::jar().truth(1)).unwrap();
    assert!((found[0].joint.largest_position() - truth.angle_rad).abs() < 0.01);
}

#[test]
fn a_part_that_touches_nothing_is_said_to() {
    let mut scene = Scene::box_with_lid_and_drawer();
    scene.parts[1].boxes[0].0.z += 0.2;
    let found = tree_of(&scene);
    assert_eq!(found[0].parent, 0);
    assert!(
        found[0].joint.evidence.cautions.iter().any(|c| matches!(c, JointRemark::Untouched { link: 1, .. })),
        "{:?}",
        found[0].joint.evidence.cautions
    );
}
