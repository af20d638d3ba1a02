//! Grasps on parts whose handles are known.

use nalgebra::{Point3, Translation3, Unit, UnitQuaternion, Vector3};

use super::{
    ArticulatedModel, Grasp, JointKind, Seat,
    example::{box_mesh, cabinet},
    grasp::grasps_of_joint,
};
use geometry::Pose;
use surface::{ConvexSolid, TriangleMesh, merged_mesh};

/// A box: lower and upper corner in the world, meters.
type Corners = [[f64; 3]; 2];

const BODY: Corners = [[-0.2, -0.25, 0.0], [0.2, 0.25, 0.6]];
const PLATE: Corners = [[0.2, -0.25, 0.02], [0.22, 0.25, 0.58]];
/// An upright bar, 20 mm wide, on two posts of the plate.
const BAR: [Corners; 3] = [
    [[0.25, 0.18, 0.25], [0.262, 0.2, 0.37]],
    [[0.22, 0.18, 0.25], [0.25, 0.2, 0.26]],
    [[0.22, 0.18, 0.36], [0.25, 0.2, 0.37]],
];
const BAR_MIDDLE: [f64; 3] = [0.256, 0.19, 0.31];

fn solids(boxes: &[Corners]) -> Vec<ConvexSolid> {
    boxes.iter().map(|[lo, hi]| ConvexSolid::cuboid(&Point3::from(*lo), &Point3::from(*hi))).collect()
}

fn surface(solids: &[ConvexSolid]) -> TriangleMesh {
    let meshes: Vec<TriangleMesh> = solids.iter().map(ConvexSolid::to_mesh).collect();
    merged_mesh(&meshes.iter().collect::<Vec<_>>())
}

/// A body and a part on it, both given in the world where the joint is at 0.
fn twin(body: &[Corners], part: Vec<ConvexSolid>, kind: JointKind) -> ArticulatedModel {
    let mut model = cabinet();
    model.links.pop();
    model.joints.pop();
    let (at, axis, upper) = match kind {
        JointKind::Prismatic => (Vector3::zeros(), Vector3::x_axis(), 0.3),
        _ => (Vector3::new(0.2, -0.25, 0.0), -Vector3::z_axis(), 1.5),
    };
    let joint = &mut model.joints[0];
    (joint.kind, joint.axis, joint.parent_from_joint) = (kind, axis, Translation3::from(at).into());
    (joint.limit.lower, joint.limit.upper) = (0.0, upper);
    model.states = vec![vec![0.0], vec![0.2]];
    let of_part: Vec<ConvexSolid> =
        part.iter().map(|s| s.transformed(&Translation3::from(-at).into())).collect();
    for (link, solids) in model.links.iter_mut().zip([solids(body), of_part]) {
        (link.visual, link.collision) = (surface(&solids), solids);
    }
    model
}

fn door(boxes: &[Corners]) -> ArticulatedModel {
    twin(&[BODY], solids(boxes), JointKind::Revolute)
}

fn drawer(body: &[Corners], boxes: &[Corners]) -> ArticulatedModel {
    twin(body, solids(boxes), JointKind::Prismatic)
}

/// Where the pads meet the part in the world at position 0, the closing direction and the approach.
fn pads(model: &ArticulatedModel, grasp: &Grasp) -> [Vector3<f64>; 3] {
    let pose = model.world_from_link(1, &[0.0]) * grasp.link_from_grasp;
    let approach = pose * Vector3::z();
    [pose.translation.vector - 0.008 * approach, pose * Vector3::x(), approach]
}

fn with_bar() -> Vec<Corners> {
    [vec![PLATE], BAR.to_vec()].concat()
}

#[test]
fn a_bar_is_taken_in_its_middle_from_the_front() {
    let model = door(&with_bar());
    let found = grasps_of_joint(&model, 0);
    assert_eq!(found.len(), 3, "{found:?}");
    let [at, closing, approach] = pads(&model, &found[0]);
    assert!((at - Vector3::from(BAR_MIDDLE)).norm() < 1e-6, "{at}");
    assert!(closing.y.abs() > 1.0 - 1e-9 && approach.x < 1e-9 - 1.0, "{closing} {approach}");
    for grasp in &found {
        let at = pads(&model, grasp)[0];
        assert!((at.z - 0.31).abs() < 0.06 && (at.y - 0.19).abs() < 1e-6, "{at}");
        assert!((grasp.width_m - 0.02).abs() < 1e-9 && grasp.off_rad < 1e-6 && grasp.is_seen);
    }
}

#[test]
fn a_knob_is_taken_from_the_front() {
    // Eight sides, 30 mm across them, 25 mm deep.
    let corner = |k: usize| {
        let angle = std::f64::consts::FRAC_PI_8 * (2 * k + 1) as f64;
        let radius = 0.015 / std::f64::consts::FRAC_PI_8.cos();
        Point3::new(0.0, radius * angle.cos(), 0.3 + radius * angle.sin())
    };
    let corners: Vec<_> = (0..8).map(corner).collect();
    let knob = ConvexSolid::prism(&corners, &Vector3::x(), 0.22, 0.245);
    let part = [solids(&[PLATE]), vec![knob]].concat();
    let model = twin(&[BODY], part, JointKind::Prismatic);
    let found = grasps_of_joint(&model, 0);
    assert_eq!(found.len(), 1, "{found:?}");
    let [at, _, approach] = pads(&model, &found[0]);
    assert!(at.y.hypot(at.z - 0.3) < 1e-6 && at.x > 0.22 && at.x < 0.245, "{at}");
    assert!((found[0].width_m - 0.03).abs() < 1e-6 && approach.x < -0.999, "{found:?}");
}

#[test]
fn a_door_without_a_handle_is_taken_by_a_free_edge_alone() {
    assert_eq!(grasps_of_joint(&door(&[PLATE]), 0), []);
    // It stands 70 mm over the body's side.
    let model = door(&[[PLATE[0], [0.22, 0.32, 0.58]]]);
    let found = grasps_of_joint(&model, 0);
    let [at, closing, approach] = pads(&model, &found[0]);
    assert!((found[0].width_m - 0.02).abs() < 1e-9 && at.y > 0.25, "{at}");
    assert!(closing.x.abs() > 0.999 && approach.y < -0.999, "{closing} {approach}");
    // A wall 10 mm behind it leaves no room for a finger.
    let wall = [[0.1, 0.25, 0.0], [0.19, 0.4, 0.7]];
    let over = solids(&[[PLATE[0], [0.22, 0.32, 0.58]]]);
    assert_eq!(grasps_of_joint(&twin(&[BODY, wall], over, JointKind::Revolute), 0), []);
}

#[test]
fn nothing_narrow_stands_in_a_recess() {
    // 100 mm by 40 mm, 15 mm deep.
    let front = [
        [[0.2, -0.25, 0.02], [0.205, 0.25, 0.58]],
        [[0.205, -0.25, 0.02], [0.22, 0.25, 0.28]],
        [[0.205, -0.25, 0.32], [0.22, 0.25, 0.58]],
        [[0.205, -0.25, 0.28], [0.22, -0.05, 0.32]],
        [[0.205, 0.05, 0.28], [0.22, 0.25, 0.32]],
    ];
    assert_eq!(grasps_of_joint(&drawer(&[BODY], &front), 0), []);
}

#[test]
fn what_is_too_wide_or_too_near_is_not_taken() {
    let wide = [PLATE, [[0.22, -0.04, 0.26], [0.25, 0.04, 0.34]]];
    assert_eq!(grasps_of_joint(&drawer(&[BODY], &wide), 0), []);
    // No finger gets behind a bar 10 mm off the plate from the side, nor past it from the front.
    let low = [PLATE, [[0.22, -0.25, 0.3], [0.228, 0.25, 0.31]]];
    assert_eq!(grasps_of_joint(&drawer(&[BODY], &low), 0), []);
}

#[test]
fn the_hand_must_be_free_over_all_of_the_motion() {
    let free = grasps_of_joint(&drawer(&[BODY], &with_bar()), 0);
    assert_eq!(free.len(), 3);
    // The open drawer's hand reaches this wall; on its way to the closed one it does not.
    let wall = [[0.6, -0.3, 0.0], [0.62, 0.3, 0.6]];
    let model = drawer(&[BODY, wall], &with_bar());
    let found = grasps_of_joint(&model, 0);
    assert!(found.iter().all(|g| pads(&model, g)[2].x > -0.5), "{found:?}");
    let mut model = drawer(&[BODY, wall], &with_bar());
    model.joints[0].limit.upper = 0.1;
    assert_eq!(grasps_of_joint(&model, 0), free);
}

#[test]
fn no_hand_comes_from_behind_what_closes() {
    // A fin on the back of a front, with nothing else there.
    let fin = [[0.15, -0.2, 0.3], [0.2, 0.2, 0.31]];
    let mut model = drawer(&[[[-0.2, 0.3, 0.0], [0.2, 0.32, 0.6]]], &[PLATE, fin]);
    assert!(grasps_of_joint(&model, 0).iter().any(|g| pads(&model, g)[2].x > 0.999));
    model.joints[0].limit.closed = Some(Seat { position: 0.0, std: 1e-3, contact_share: 0.3, above: false });
    assert!(grasps_of_joint(&model, 0).iter().all(|g| pads(&model, g)[2].x < 0.51));
}

#[test]
fn a_face_that_no_view_saw_is_marked_and_a_place_without_surface_refused() {
    let mut model = door(&with_bar());
    // Of the bar only the side at y = 0.2.
    let side = [[0.25, 0.2, 0.25], [0.262, 0.2, 0.37]].map(|p: [f64; 3]| p.map(|x| x as f32));
    let shift: Pose = model.joints[0].parent_from_joint.inverse();
    let side = box_mesh(side[0], side[1], [9; 3]).transformed(&shift);
    let plate = surface(&solids(&[PLATE])).transformed(&shift);
    model.links[1].visual = merged_mesh(&[&plate, &side]);
    let found = grasps_of_joint(&model, 0);
    assert!(!found.is_empty() && found.iter().all(|g| !g.is_seen), "{found:?}");
    model.links[1].visual = plate;
    assert_eq!(grasps_of_joint(&model, 0), []);
}

/// The same grasps, the second after a motion.
fn assert_alike(found: &[Grasp], expected: &[Grasp], motion: &Pose) {
    assert_eq!(found.len(), expected.len(), "{found:?}");
    for (a, b) in found.iter().zip(expected) {
        let off = (motion * b.link_from_grasp).inverse() * a.link_from_grasp;
        assert!(off.translation.vector.norm() < 1e-6 && off.rotation.angle() < 1e-6, "{a:?} {b:?}");
        assert!((a.width_m - b.width_m).abs() < 1e-9 && (a.off_rad - b.off_rad).abs() < 1e-6);
    }
}

#[test]
fn a_moved_object_has_the_same_grasps() {
    let model = door(&with_bar());
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.7);
    let motion = Pose::from_parts(Vector3::new(0.3, -1.1, 0.4).into(), turn);
    // All frames stand parallel to the world's, as reconstruction puts them.
    let mut moved = model.clone();
    let joint = &mut moved.joints[0];
    let at = motion * Point3::from(joint.parent_from_joint.translation.vector);
    joint.parent_from_joint = Translation3::from(at.coords).into();
    joint.axis = turn * joint.axis;
    let of_part = Pose::from_parts(Translation3::identity(), turn);
    for (link, by) in moved.links.iter_mut().zip([motion, of_part]) {
        link.collision = link.collision.iter().map(|s| s.transformed(&by)).collect();
        link.visual = link.visual.transformed(&by);
    }
    assert_alike(&grasps_of_joint(&moved, 0), &grasps_of_joint(&model, 0), &of_part);
}

#[test]
fn an_axis_may_point_either_way() {
    for model in [door(&with_bar()), drawer(&[BODY], &with_bar())] {
        let mut mirrored = model.clone();
        let joint = &mut mirrored.joints[0];
        joint.axis = Unit::new_unchecked(-joint.axis.into_inner());
        (joint.limit.lower, joint.limit.upper) = (-joint.limit.upper, 0.0);
        assert_alike(&grasps_of_joint(&mirrored, 0), &grasps_of_joint(&model, 0), &Pose::identity());
    }
}
