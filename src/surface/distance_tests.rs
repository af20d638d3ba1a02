//! Tests of the distance field against analytic shapes and brute force.

use nalgebra::{Point3, Vector3};

use super::*;
use crate::{
    marching_cubes, merged_mesh,
    shapes::{box_mesh, cuboid, grid_of, sphere, sphere_mesh, torus},
};

/// Largest error in spacings, and the number of wrong signs further than 0.1 spacings from the surface.
fn errors(grid: &Grid3<f32>, truth: impl Fn(&Point3<f64>) -> f64) -> (f64, usize) {
    let mut worst = 0.0f64;
    let mut wrong = 0;
    for i in 0..grid.values.len() {
        let d = f64::from(grid.values[i]);
        let t = truth(&grid.position_of_index(i));
        worst = worst.max((d.abs() - t.abs()).abs() / grid.spacing_m);
        wrong += usize::from(d * t < 0.0 && t.abs() > 0.1 * grid.spacing_m);
    }
    (worst, wrong)
}

fn distance(mesh: &TriangleMesh, nodes: &Grid3<f32>) -> Grid3<f32> {
    signed_distance(mesh, nodes, None, &DistanceOptions::default()).unwrap()
}

#[test]
fn a_box_of_twelve_triangles_is_exact() {
    let half = Vector3::new(0.31, 0.17, 0.23);
    let (worst, wrong) = errors(&distance(&box_mesh(half.cast()), &grid_of(0.5, 51, |_| 0.0)), cuboid(half));
    assert!(worst < 1e-3, "{worst}");
    assert_eq!(wrong, 0);
}

#[test]
fn a_fine_sphere_and_torus_are_within_a_tenth_of_a_spacing() {
    let nodes = grid_of(0.5, 61, |_| 0.0);
    let (worst, wrong) = errors(&distance(&sphere_mesh(0.3, 200), &nodes), sphere(0.3));
    assert!(worst < 0.1 && wrong == 0, "{worst} {wrong}");
    let ring = marching_cubes(&grid_of(0.5, 200, torus(0.25, 0.1)), 0.0);
    let (worst, wrong) = errors(&distance(&ring, &nodes), torus(0.25, 0.1));
    assert!(worst < 0.1 && wrong == 0, "{worst} {wrong}");
}

#[test]
fn a_rough_mesh_agrees_with_brute_force() {
    let mut rng = numeric::random::stage_rng(3, "rough", 0);
    let mut field = grid_of(0.5, 9, sphere(0.3));
    for v in &mut field.values {
        *v += 0.1 * (rand_core::Rng::next_u32(&mut rng) as f32 / u32::MAX as f32 - 0.5);
    }
    for i in 0..field.values.len() {
        if field.position_of_index(i).coords.amax() > 0.45 {
            field.values[i] = 1.0;
        }
    }
    let mesh = marching_cubes(&field, 0.0);
    let nodes = grid_of(0.6, 41, |_| 0.0);
    let grid = distance(&mesh, &nodes);
    let positions: Vec<Vector3<f32>> = mesh.vertices.iter().map(|p| p.coords).collect();
    let surface = Pseudonormals::of_mesh(&mesh, &positions);
    let mut worst = 0.0f64;
    let mut wrong = 0;
    let mut off = 0;
    let mut sum = 0.0;
    for i in 0..grid.values.len() {
        let p = grid.position_of_index(i).coords.cast::<f32>();
        let candidates = (0..surface.corners.len()).map(|t| {
            let (q, feature) = closest_on_triangle(&p, &surface.corners[t]);
            ((p - q).norm(), (p - q).dot(&surface.feature_normal(t, feature)) < 0.0)
        });
        let (d, inside) = candidates.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
        let error = f64::from((grid.values[i].abs() - d).abs()) / grid.spacing_m;
        worst = worst.max(error);
        sum += error;
        off += usize::from(error > 0.01);
        wrong += usize::from((grid.values[i] < 0.0) != inside && f64::from(d) > 0.01 * grid.spacing_m);
    }
    let count = grid.values.len();
    assert!(
        worst < 0.4 && off < count / 100 && sum / (count as f64) < 1e-3 && wrong == 0,
        "{worst} {off} {sum} {wrong}"
    );
}

#[test]
fn far_nodes_are_right_to_a_spacing_and_near_ones_are_as_ever() {
    let nodes = grid_of(0.5, 61, |_| 0.0);
    let ring = marching_cubes(&grid_of(0.5, 200, torus(0.2, 0.1)), 0.0);
    let whole = distance(&ring, &nodes);
    let near_m = 4.0 * nodes.spacing_m;
    let options = DistanceOptions { near_m, ..DistanceOptions::default() };
    let some = signed_distance(&ring, &nodes, None, &options).unwrap();
    let mut near = 0;
    let mut far = 0;
    for (a, b) in whole.values.iter().zip(&some.values) {
        assert_eq!(*a < 0.0, *b < 0.0);
        if f64::from(a.abs()) <= near_m {
            assert_eq!(a, b);
            near += 1;
        } else {
            assert!(f64::from((a - b).abs()) < nodes.spacing_m, "{a} {b}");
            far += usize::from(a != b);
        }
    }
    assert!(near > 10_000 && far > 100_000, "{near} {far}");
}

/// A spherical shell: outer radius 0.4, cavity of radius 0.25 whose surface faces into the cavity.
fn hollow() -> TriangleMesh {
    let mut cavity = sphere_mesh(0.25, 60);
    for t in &mut cavity.triangles {
        t.swap(0, 1);
    }
    merged_mesh(&[&sphere_mesh(0.4, 80), &cavity])
}

#[test]
fn an_enclosed_cavity_is_outside_unless_asked_otherwise() {
    let nodes = grid_of(0.5, 41, |_| 0.0);
    let shell = |p: &Point3<f64>| (p.coords.norm() - 0.4).max(0.25 - p.coords.norm());
    let (worst, wrong) = errors(&distance(&hollow(), &nodes), shell);
    assert!(worst < 0.05 && wrong == 0, "{worst} {wrong}");
    let options = DistanceOptions { solid_cavities: true, ..DistanceOptions::default() };
    let solid = signed_distance(&hollow(), &nodes, None, &options).unwrap();
    let (_, wrong) = errors(&solid, |p| if p.coords.norm() < 0.4 { -shell(p).abs() } else { shell(p) });
    assert_eq!(wrong, 0);
    // A view into the cavity makes it outside again.
    let mut free = Grid3 {
        origin: nodes.origin,
        spacing_m: nodes.spacing_m,
        dims: nodes.dims,
        values: vec![false; nodes.values.len()],
    };
    let middle = nodes.nearest_node(&Point3::origin()).unwrap();
    free.values[middle] = true;
    let seen = signed_distance(&hollow(), &nodes, Some(&free), &options).unwrap();
    assert_eq!(errors(&seen, shell).1, 0);
}

#[test]
fn observed_free_space_is_outside() {
    let nodes = grid_of(0.5, 31, |_| 0.0);
    let free = Grid3 {
        origin: nodes.origin,
        spacing_m: nodes.spacing_m,
        dims: nodes.dims,
        values: vec![true; nodes.values.len()],
    };
    let grid =
        signed_distance(&sphere_mesh(0.3, 40), &nodes, Some(&free), &DistanceOptions::default()).unwrap();
    assert!(grid.values.iter().all(|&v| v >= 0.0));
}

#[test]
fn an_open_box_is_inside_up_to_its_opening_and_not_below() {
    let half = Vector3::new(0.25f32, 0.25, 0.25);
    let mut open = box_mesh(half);
    open.triangles.drain(8..10);
    assert_eq!(crate::edge_defects(&open).open, 4);
    let grid = distance(&open, &grid_of(0.5, 51, |_| 0.0));
    let at = |x: f64, y: f64, z: f64| grid.values[grid.nearest_node(&Point3::new(x, y, z)).unwrap()];
    assert!((at(0.0, 0.0, 0.1) + 0.15).abs() < 1e-4);
    assert!(at(0.2, 0.0, -0.1) < 0.0 && at(0.3, 0.0, 0.0) > 0.0);
    assert!(at(0.0, 0.0, -0.45) > 0.0 && at(0.2, 0.2, -0.4) > 0.0);
    // Right at the rim the walls go on.
    assert!(at(0.24, 0.0, -0.26) < 0.0 && at(0.26, 0.0, -0.26) > 0.0);
}

#[test]
fn a_mesh_that_is_a_soup_has_the_same_signs() {
    let mesh = box_mesh(Vector3::new(0.31, 0.17, 0.23));
    let corners: Vec<u32> = mesh.triangles.iter().flatten().copied().collect();
    let soup = TriangleMesh {
        vertices: corners.iter().map(|&i| mesh.vertices[i as usize]).collect(),
        triangles: (0..12).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        colors: Vec::new(),
    };
    let nodes = grid_of(0.5, 31, |_| 0.0);
    assert_eq!(distance(&soup, &nodes), distance(&mesh, &nodes));
}

#[test]
fn unusable_input_is_refused() {
    let nodes = grid_of(0.5, 11, |_| 0.0);
    let tried =
        |mesh: &TriangleMesh| signed_distance(mesh, &nodes, None, &DistanceOptions::default()).unwrap_err();
    assert_eq!(tried(&TriangleMesh::default()), DistanceError::EmptyMesh);
    let mut mesh = sphere_mesh(0.3, 10);
    assert_eq!(
        tried(&mesh.transformed(&geometry::Pose::translation(5.0, 0.0, 0.0))),
        DistanceError::OutsideGrid
    );
    mesh.triangles[4][1] = 100_000;
    assert_eq!(tried(&mesh), DistanceError::BadTriangle { triangle: 4 });
    let mut mesh = sphere_mesh(0.3, 10);
    mesh.vertices[0].x = f32::NAN;
    assert!(matches!(tried(&mesh), DistanceError::BadTriangle { .. }));
    let free =
        Grid3 { origin: nodes.origin, spacing_m: nodes.spacing_m, dims: [2; 3], values: vec![false; 8] };
    let refused = signed_distance(&sphere_mesh(0.3, 10), &nodes, Some(&free), &DistanceOptions::default());
    assert!(matches!(refused, Err(DistanceError::FreeSpaceShape { .. })));
}

#[test]
fn the_number_of_threads_does_not_matter() {
    let mesh = sphere_mesh(0.3, 30);
    let nodes = grid_of(0.5, 31, |_| 0.0);
    let with = |n| {
        rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap().install(|| distance(&mesh, &nodes))
    };
    assert_eq!(with(1), with(3));
}
