//! What mended borders look like, by known answers.

use std::f64::consts::TAU;

use nalgebra::{Point3, Vector3};

use super::{Readings, loops::border_loops, mend_borders, plates::plate};
use crate::{
    TriangleMesh,
    shapes::{box_mesh, sphere_mesh},
};
use capture::NoiseConfig;
use geometry::Pose;

fn nothing(_: &Point3<f64>) -> bool {
    false
}

/// No depth, only what is empty.
fn empty(is_seen_empty: &(dyn Fn(&Point3<f64>) -> bool + Sync)) -> Readings<'_> {
    Readings { views: &[], noise: NoiseConfig::default(), is_seen_empty }
}

/// A plate of 60 x 40 voxels at the origin whose lower and upper rims have teeth: of whole cells below, of
/// vertices that lie half a voxel out of line above.
fn toothed() -> TriangleMesh {
    let mut mesh = plate(60, 41, |x, y| y > 0 || x % 2 == 0);
    for p in &mut mesh.vertices {
        p.y -= 1.0;
        if p.y == 40.0 {
            p.y += if p.x as u32 % 2 == 0 { 0.5 } else { -0.5 };
        }
    }
    mesh
}

fn border_points(mesh: &TriangleMesh) -> Vec<Point3<f32>> {
    border_loops(mesh).unwrap().iter().flatten().map(|&v| mesh.vertices[v as usize]).collect()
}

#[test]
fn toothed_rims_become_straight_and_keep_their_corners() {
    // Filled and cut teeth end at different places, both straight.
    for (close, low) in [(true, -0.5), (false, 0.0)] {
        let mended = mend_borders(&toothed(), 1.0, close, &empty(&nothing)).mesh;
        assert_eq!(border_loops(&mended).unwrap().len(), 1);
        let points = border_points(&mended);
        let spread = |side: &dyn Fn(&Point3<f32>) -> bool| {
            let y = points.iter().filter(|p| (4.0..56.0).contains(&p.x) && side(p)).map(|p| p.y);
            (y.clone().fold(f32::INFINITY, f32::min), y.fold(f32::NEG_INFINITY, f32::max))
        };
        let (lowest, highest) = spread(&|p| p.y < 20.0);
        assert!(highest - lowest < 0.1 && (lowest - low).abs() < 0.6, "{lowest} {highest}");
        let (lowest, highest) = spread(&|p| p.y > 20.0);
        assert!(highest - lowest < 0.1 && (lowest - 40.0).abs() < 0.1, "{lowest} {highest}");
    }
}

#[test]
fn the_corners_of_a_square_stay() {
    let mended = mend_borders(&plate(40, 40, |_, _| true), 1.0, true, &empty(&nothing));
    assert_eq!((mended.holes, mended.assumed_m2.to_bits()), (0, 0), "not -0 either");
    for corner in [[0.0, 0.0], [40.0, 0.0], [40.0, 40.0], [0.0, 40.0]] {
        let corner = Point3::new(corner[0], corner[1], 0.0);
        let nearest =
            border_points(&mended.mesh).iter().map(|p| (p - corner).norm()).fold(f32::MAX, f32::min);
        assert!(nearest < 0.5, "{nearest}");
    }
    assert!((mended.mesh.area_m2() - 1600.0).abs() < 2.0, "{}", mended.mesh.area_m2());
}

#[test]
fn a_round_hole_stays_where_views_saw_through_it_and_closes_elsewhere() {
    let from_middle = |x: u32, y: u32| f64::from(x).mul_add(1.0, -19.5).hypot(f64::from(y) - 19.5);
    let mesh = plate(40, 40, |x, y| from_middle(x, y) > 4.5);
    let through = |p: &Point3<f64>| (p.x - 20.0).hypot(p.y - 20.0) < 3.0;
    let open = mend_borders(&mesh, 1.0, true, &empty(&through));
    assert_eq!(border_loops(&open.mesh).unwrap().len(), 2);
    assert_eq!((open.holes, open.assumed_m2), (0, 0.0));
    let closed = mend_borders(&mesh, 1.0, true, &empty(&nothing));
    assert_eq!(border_loops(&closed.mesh).unwrap().len(), 1);
    assert_eq!(closed.holes, 1);
    // Triangles that hang at its rim are taken off before.
    let hole_m2 = 1600.0 - mesh.area_m2();
    assert!((hole_m2..hole_m2 + 4.1).contains(&closed.assumed_m2), "{}", closed.assumed_m2);
    assert_eq!(border_loops(&mend_borders(&mesh, 1.0, false, &empty(&nothing)).mesh).unwrap().len(), 2);
}

#[test]
fn a_closed_mesh_and_one_without_a_clear_border_come_back_as_they_are() {
    let mut ball = sphere_mesh(0.4, 20);
    ball.colors = vec![[1, 2, 3]; ball.vertices.len()];
    assert_eq!(mend_borders(&ball, 0.02, true, &empty(&nothing)).mesh, ball);
    let mut doubled = box_mesh(Vector3::repeat(0.1));
    doubled.triangles.extend([doubled.triangles[0]; 2]);
    assert_eq!(mend_borders(&doubled, 0.02, true, &empty(&nothing)).mesh, doubled);
    assert!(mend_borders(&TriangleMesh::default(), 0.02, true, &empty(&nothing)).mesh.is_empty());
}

/// A torn piece of a wide cylinder: a rim that waves, holes of many shapes.
fn torn() -> TriangleMesh {
    let wave = |x: u32| (2.5 + 2.0 * (f64::from(x) * 0.7).sin() + 1.5 * (f64::from(x) * 2.3).sin()) as u32;
    let hole = |x: u32, y: u32| (x * x * 7 + x * y * 3 + y * 11) % 23 == 0 && y > 12;
    let mut mesh = plate(60, 50, |x, y| y >= wave(x) && !hole(x, y));
    for p in &mut mesh.vertices {
        let angle = f64::from(p.x) / 200.0 * TAU;
        let lift = (f64::from(p.x) * 1.3 + f64::from(p.y) * 0.9).sin() * 0.1;
        *p = Point3::new(angle.sin() * (31.8 + lift), f64::from(p.y), angle.cos() * (31.8 + lift)).cast();
    }
    mesh
}

#[test]
fn no_triangle_turns_over_and_the_result_is_the_same_every_time() {
    let mesh = torn();
    let mended = mend_borders(&mesh, 1.0, true, &empty(&nothing));
    assert!(mended.holes > 20 && mended.assumed_m2 > 20.0);
    assert_eq!(mend_borders(&mesh, 1.0, true, &empty(&nothing)), mended);
    for t in 0..mended.mesh.triangles.len() {
        let [a, b, c] = mended.mesh.corners(t);
        let mut out = (a.coords + b.coords + c.coords) / 3.0;
        out.y = 0.0;
        let n = mended.mesh.area_normal(t);
        assert!(n.dot(&out) > 0.0, "{n} {a} {b} {c}");
    }
}

#[test]
fn rigid_motions_commute() {
    let motion = Pose::new(Vector3::new(3.0, -2.0, 1.0), Vector3::new(0.4, -1.1, 0.7));
    let mesh = torn();
    let seen = |p: &Point3<f64>| (p.y - 20.0).abs() < 1.0;
    let first = mend_borders(&mesh, 1.0, true, &empty(&seen));
    let seen_moved = |p: &Point3<f64>| seen(&(motion.inverse() * p));
    let moved = mend_borders(&mesh.transformed(&motion), 1.0, true, &empty(&seen_moved));
    assert_eq!((first.holes, &first.mesh.triangles), (moved.holes, &moved.mesh.triangles));
    let expected = first.mesh.transformed(&motion);
    let farthest = expected.vertices.iter().zip(&moved.mesh.vertices).map(|(p, q)| (p - q).norm());
    assert!(farthest.fold(0.0, f32::max) < 1e-3);
}
