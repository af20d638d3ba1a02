//! Plates with borders of many shapes, for the tests.

use nalgebra::Point3;

use crate::{TriangleMesh, drop_unused_vertices};

/// A flat plate normal to z, made of the cells for which `has` is true; each has sides of 1 m and two
/// triangles. The origin is a corner of cell (0, 0).
pub(super) fn plate(nx: u32, ny: u32, has: impl Fn(u32, u32) -> bool) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for y in 0..=ny {
        mesh.vertices.extend((0..=nx).map(|x| Point3::new(x as f32, y as f32, 0.0)));
    }
    let at = |x: u32, y: u32| x + (nx + 1) * y;
    for (x, y) in (0..ny).flat_map(|y| (0..nx).map(move |x| (x, y))).filter(|&(x, y)| has(x, y)) {
        let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    drop_unused_vertices(&mesh)
}
