//! Extracts the surface where a sampled field takes a given value (Lorensen and Cline 1987), with the case
//! table of `cube_table`.

use nalgebra::Point3;
use rayon::prelude::*;

use super::{TriangleMesh, cube_table::CUBE_TABLE};
use geometry::Grid3;

/// Node flag: value below the iso value.
const INSIDE: u8 = 1;
/// Node flag: no value. Shifted left by up to three bits, it stays clear of the inside flags.
const UNKNOWN: u8 = 16;
/// Least distance of a vertex from the ends of its edge, as a share of the edge: rounding would flip smaller
/// triangles. chosen: a hundredth of a voxel is below any reading
const MIN_FRACTION: f64 = 0.01;
/// Cell layers of one task.
const LAYERS_PER_TASK: usize = 8;

/// Surface where the field crosses `iso`, in the grid's world frame; outward is towards larger values.
///
/// Vertices are shared: each cut grid edge has one. Where all values are finite every triangle side belongs
/// to two triangles, except at the border of the grid. A cell with a non-finite corner (unknown) has no
/// triangle, so the surface is open there. The result does not depend on the number of threads.
pub fn marching_cubes(grid: &Grid3<f32>, iso: f32) -> TriangleMesh {
    let [nx, ny, nz] = grid.dims;
    if nx < 2 || ny < 2 || nz < 2 {
        return TriangleMesh::default();
    }
    let values = grid.values.par_iter().with_min_len(1 << 14);
    let flags: Vec<u8> =
        values.map(|v| if v.is_finite() { u8::from(*v < iso) * INSIDE } else { UNKNOWN }).collect();
    let layers: Vec<Layer> = (0..nz).into_par_iter().map(|z| Layer::of_grid(grid, iso, &flags, z)).collect();
    // Vertices are numbered by layer, independent of the thread that made them.
    let mut firsts = Vec::with_capacity(nz);
    let mut count = 0;
    for layer in &layers {
        firsts.push(count);
        count += layer.slots.len() as u32;
    }
    let tasks = (nz - 1).div_ceil(LAYERS_PER_TASK);
    let pieces: Vec<Vec<[u32; 3]>> = (0..tasks)
        .into_par_iter()
        .map(|task| {
            let to = ((task + 1) * LAYERS_PER_TASK).min(nz - 1);
            layer_triangles(&flags, grid.dims, &layers, &firsts, task * LAYERS_PER_TASK..to)
        })
        .collect();
    let mut mesh = TriangleMesh { triangles: pieces.concat(), ..TriangleMesh::default() };
    mesh.vertices.reserve(count as usize);
    for layer in layers {
        mesh.vertices.extend(layer.positions);
    }
    // Next to unknown nodes there are vertices without triangles.
    if flags.par_iter().with_min_len(1 << 14).any(|&f| f == UNKNOWN) {
        super::drop_unused_vertices(&mesh)
    } else {
        mesh
    }
}

/// The vertices on the edges from the nodes of one layer.
struct Layer {
    /// `axis * nx * ny + nx * y + x` of each cut edge, in the order of `positions`.
    slots: Vec<u32>,
    /// World position of each vertex.
    positions: Vec<Point3<f32>>,
}

impl Layer {
    fn of_grid(grid: &Grid3<f32>, iso: f32, flags: &[u8], z: usize) -> Self {
        let [nx, ny, nz] = grid.dims;
        let plane = nx * ny;
        let mut layer = Self { slots: Vec::new(), positions: Vec::new() };
        for axis in 0..3 {
            let mx = nx - usize::from(axis == 0);
            let my = ny - usize::from(axis == 1);
            if axis == 2 && z + 1 == nz {
                break;
            }
            let stride = [1, nx, plane][axis];
            for y in 0..my {
                let row = z * plane + y * nx;
                for (x, (&a, &b)) in
                    flags[row..row + mx].iter().zip(&flags[row + stride..row + stride + mx]).enumerate()
                {
                    // The edge is cut and both ends are known: an unknown end sets another bit.
                    if a ^ b == INSIDE {
                        let to = f64::from(grid.values[row + x + stride]);
                        let from = f64::from(grid.values[row + x]);
                        let t =
                            ((f64::from(iso) - from) / (to - from)).clamp(MIN_FRACTION, 1.0 - MIN_FRACTION);
                        let mut p = grid.node_position(x, y, z);
                        p[axis] += t * grid.spacing_m;
                        layer.slots.push((axis * plane + y * nx + x) as u32);
                        layer.positions.push(p.cast());
                    }
                }
            }
        }
        layer
    }

    /// Writes the vertex number of each cut edge at its slot; other slots keep their old numbers and are
    /// never read.
    fn write_numbers(&self, first: u32, numbers: &mut [u32]) {
        for (i, &slot) in self.slots.iter().enumerate() {
            numbers[slot as usize] = first + i as u32;
        }
    }
}

/// Triangles of the cells in the given layers.
fn layer_triangles(
    flags: &[u8],
    dims: [usize; 3],
    layers: &[Layer],
    firsts: &[u32],
    range: std::ops::Range<usize>,
) -> Vec<[u32; 3]> {
    let [nx, ny, _] = dims;
    let plane = nx * ny;
    // Where each edge of a cell finds its vertex number: whether in the upper layer, and the offset from the
    // cell's slot.
    let slots: Vec<(bool, usize)> = CUBE_TABLE
        .edges
        .iter()
        .map(|e| {
            let [dx, dy, dz] = e.lower_end_offset();
            (dz == 1, e.axis * plane + dy * nx + dx)
        })
        .collect();
    // Vertex numbers of two layers at a time: a table of the whole grid would take three numbers a node.
    let mut below = vec![0; 3 * plane];
    let mut above = vec![0; 3 * plane];
    layers[range.start].write_numbers(firsts[range.start], &mut above);
    let mut triangles = Vec::new();
    for z in range {
        std::mem::swap(&mut below, &mut above);
        layers[z + 1].write_numbers(firsts[z + 1], &mut above);
        for y in 0..ny - 1 {
            let [r0, r1, r2, r3] = [(y, z), (y + 1, z), (y, z + 1), (y + 1, z + 1)]
                .map(|(y, z)| &flags[z * plane + y * nx..][..nx]);
            let column = |x: usize| r0[x] | r1[x] << 1 | r2[x] << 2 | r3[x] << 3;
            let mut left = column(0);
            for x in 0..nx - 1 {
                let right = column(x + 1);
                let a = left;
                let b = right;
                left = right;
                // All corners outside, all inside, or one unknown.
                if (a == b && (a == 0 || a == 15)) || (a | b) & 0xF0 != 0 {
                    continue;
                }
                let at = y * nx + x;
                for t in &CUBE_TABLE.triangles[usize::from(a | b << 4)] {
                    triangles.push(t.map(|e| {
                        let (upper, slot) = slots[e as usize];
                        if upper { above[slot + at] } else { below[slot + at] }
                    }));
                }
            }
        }
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        edge_defects, is_watertight,
        shapes::{cuboid, grid_of, sphere, torus, volume_m3},
    };
    use nalgebra::Vector3;
    use rand_core::Rng as _;
    use std::f64::consts::PI;

    #[test]
    fn a_sphere_has_its_area_and_volume_and_faces_outward() {
        let mesh = marching_cubes(&grid_of(0.5, 65, sphere(0.4)), 0.0);
        assert!(is_watertight(&mesh));
        assert!((volume_m3(&mesh) / (4.0 / 3.0 * PI * 0.4f64.powi(3)) - 1.0).abs() < 2e-3);
        assert!((mesh.area_m2() / (4.0 * PI * 0.16) - 1.0).abs() < 2e-3);
        let spacing_m = 1.0 / 64.0;
        let worst =
            mesh.vertices.iter().map(|p| (f64::from(p.coords.norm()) - 0.4).abs()).fold(0.0, f64::max);
        assert!(worst < 0.02 * spacing_m, "{worst}");
    }

    #[test]
    fn closed_shapes_are_watertight_with_the_right_genus() {
        let euler = |m: &TriangleMesh| m.vertices.len() as i64 - m.triangles.len() as i64 / 2;
        let ring = marching_cubes(&grid_of(0.5, 50, torus(0.3, 0.1)), 0.0);
        assert!(is_watertight(&ring) && euler(&ring) == 0);
        // The faces of this box pass exactly through nodes.
        let block = marching_cubes(&grid_of(0.5, 41, cuboid(Vector3::new(0.25, 0.3, 0.2))), 0.0);
        assert!(is_watertight(&block) && euler(&block) == 2);
        // Edges are cut by up to half a cell.
        assert!((volume_m3(&block) - 8.0 * 0.25 * 0.3 * 0.2).abs() < 2e-3);
    }

    #[test]
    fn noise_has_every_pattern_and_still_no_defect() {
        let mut rng = numeric::random::stage_rng(1, "noise", 0);
        let mut grid = grid_of(1.0, 24, |_| 1.0);
        for z in 1..23 {
            for y in 1..23 {
                for x in 1..23 {
                    let i = grid.index(x, y, z);
                    grid.values[i] = rng.next_u32() as f32 / u32::MAX as f32 - 0.5;
                }
            }
        }
        let mesh = marching_cubes(&grid, 0.0);
        assert!(mesh.triangles.len() > 10_000);
        assert_eq!(edge_defects(&mesh), Default::default());
        assert!(volume_m3(&mesh) > 0.0);
    }

    #[test]
    fn unknown_nodes_leave_the_surface_open_and_no_loose_vertex() {
        let mut grid = grid_of(0.5, 33, sphere(0.4));
        for i in 0..grid.values.len() {
            if grid.position_of_index(i).z < -0.2 {
                grid.values[i] = f32::NAN;
            }
        }
        let mesh = marching_cubes(&grid, 0.0);
        let defects = edge_defects(&mesh);
        assert!(defects.open > 50 && defects.non_manifold == 0);
        assert!(mesh.vertices.iter().all(|p| p.z > -0.2 && p.iter().all(|c| c.is_finite())));
        let used: std::collections::BTreeSet<u32> = mesh.triangles.iter().flatten().copied().collect();
        assert_eq!(used.len(), mesh.vertices.len());
    }

    #[test]
    fn positions_follow_origin_spacing_and_iso_value() {
        let mut grid = grid_of(0.5, 33, sphere(0.3));
        grid.origin += Vector3::new(1.0, 2.0, 3.0);
        let mesh = marching_cubes(&grid, 0.1);
        let center = Point3::new(0.0, 0.0, 0.0) + Vector3::new(1.0, 2.0, 3.0).cast::<f32>();
        assert!(mesh.vertices.iter().all(|p| ((p - center).norm() - 0.4).abs() < 1e-3));
        assert!(marching_cubes(&grid, 100.0).is_empty() && marching_cubes(&grid, -100.0).is_empty());
    }

    #[test]
    fn the_number_of_threads_does_not_matter() {
        let grid = grid_of(0.5, 40, torus(0.3, 0.1));
        let with = |n| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(n)
                .build()
                .unwrap()
                .install(|| marching_cubes(&grid, 0.0))
        };
        assert_eq!(with(1), with(3));
    }
}
