//! Analytic shapes for the tests: grids of signed distances and meshes.

pub use capture::analytic::{color_of, cuboid, looking_at_origin, orbit, sphere, torus, view_of};
use geometry::Grid3;
use nalgebra::{Point3, Vector3};

use super::TriangleMesh;

/// Samples a function at the nodes of a cube `[-half, half]^3`.
pub fn grid_of(half_m: f64, nodes: usize, f: impl Fn(&Point3<f64>) -> f64) -> Grid3<f32> {
    let spacing_m = 2.0 * half_m / (nodes - 1) as f64;
    let mut g = Grid3 {
        origin: Point3::new(-half_m, -half_m, -half_m),
        spacing_m,
        dims: [nodes; 3],
        values: vec![0.0; nodes.pow(3)],
    };
    for i in 0..g.values.len() {
        g.values[i] = f(&g.position_of_index(i)) as f32;
    }
    g
}

/// A cuboid of the given half sides as twelve triangles.
pub fn box_mesh(half: Vector3<f32>) -> TriangleMesh {
    TriangleMesh::cuboid(&Point3::from(-half), &Point3::from(half))
}

/// A sphere as latitude bands; closed, outward.
pub fn sphere_mesh(radius_m: f32, bands: u32) -> TriangleMesh {
    let rows = bands;
    let columns = 2 * bands;
    let mut mesh =
        TriangleMesh { vertices: vec![Point3::new(0.0, 0.0, -radius_m)], ..TriangleMesh::default() };
    for r in 1..rows {
        let polar = std::f32::consts::PI * r as f32 / rows as f32;
        for c in 0..columns {
            let azimuth = std::f32::consts::TAU * c as f32 / columns as f32;
            mesh.vertices.push(Point3::from(
                Vector3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), -polar.cos())
                    * radius_m,
            ));
        }
    }
    mesh.vertices.push(Point3::new(0.0, 0.0, radius_m));
    let top = mesh.vertices.len() as u32 - 1;
    let at = |r: u32, c: u32| 1 + (r - 1) * columns + c % columns;
    for c in 0..columns {
        mesh.triangles.push([0, at(1, c + 1), at(1, c)]);
        for r in 1..rows - 1 {
            mesh.triangles.push([at(r, c), at(r, c + 1), at(r + 1, c + 1)]);
            mesh.triangles.push([at(r, c), at(r + 1, c + 1), at(r + 1, c)]);
        }
        mesh.triangles.push([top, at(rows - 1, c), at(rows - 1, c + 1)]);
    }
    mesh
}

/// Enclosed volume by the divergence theorem.
pub fn volume_m3(mesh: &TriangleMesh) -> f64 {
    (0..mesh.triangles.len())
        .map(|t| {
            let [a, b, c] = mesh.corners(t).map(|p| p.coords.cast::<f64>());
            a.dot(&b.cross(&c)) / 6.0
        })
        .sum()
}
