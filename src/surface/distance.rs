//! Untruncated signed distance of a mesh at the nodes of a grid (docs/method.md 3.4, node-aligned).
//!
//! Nodes within 1.5 spacings of the surface get the exact distance to the nearest triangle. From there the
//! nearest triangle spreads along the exact nearest-node transform; each node walks over the mesh to closer
//! triangles and then tries those of its six neighbors. All distances are exact point-triangle distances. On
//! request, nodes far from the surface take the distance of the nearest-node transform instead.

use std::ops::Range;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::{
    TriangleMesh,
    edt::{NO_SEED, nearest_seed},
    pseudonormal::Pseudonormals,
    triangle::{Feature, closest_on_triangle},
    welded_mesh,
};
use geometry::Grid3;

/// Half width of the band of exact distances, spacings. chosen: exact where it is read most, and cheap
const BAND: f32 = 1.5;
/// Nodes this close to the surface pass on their triangle, spacings. Every point is within 0.87 of a node.
/// chosen: a margin above 0.87
const SEED: f32 = 1.0;
/// A walk stays on triangles this close to where it began, spacings: one piece of surface.
/// chosen: as [`SEED`]
const SAME_PIECE: f32 = 1.0;
/// Layers of one task of the band pass.
const LAYERS_PER_TASK: usize = 4;

/// How the sign is decided in ambiguous places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistanceOptions {
    /// Enclosed cavities count as inside, as in the method's released code: only space connected to the
    /// border of the grid or to observed free space is outside. Without it, the winding of a cavity's own
    /// surface makes it outside.
    pub solid_cavities: bool,
    /// Within this many spacings of the border of an open mesh, its last face decides the side; farther away
    /// the node is outside.
    pub open_reach: f64,
    /// Up to this distance a node looks for its nearest triangle, meters. Farther from the surface it takes
    /// the distance, right to a spacing, and the side of the nearest node beside the surface.
    pub near_m: f64,
}

impl Default for DistanceOptions {
    fn default() -> Self {
        Self { solid_cavities: false, open_reach: 3.0, near_m: f64::INFINITY }
    }
}

/// Why there is no distance field.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum DistanceError {
    /// No triangle has three different corners.
    #[error("the mesh has no triangle; nothing was reconstructed to measure distances to")]
    EmptyMesh,
    /// A coordinate is NaN or infinite, or a triangle refers to a missing vertex.
    #[error("triangle {triangle} of the mesh has a corner that is missing or not finite")]
    BadTriangle {
        /// Index of the triangle.
        triangle: usize,
    },
    /// The grid has fewer than two nodes along an axis.
    #[error("a distance grid needs at least 2 nodes along each axis, not {dims:?}")]
    TooFewNodes {
        /// Nodes along x, y, z.
        dims: [usize; 3],
    },
    /// The free space grid has other nodes than the distance grid.
    #[error("the free space grid has {free:?} nodes and the distance grid {nodes:?}; both must be the same")]
    FreeSpaceShape {
        /// Nodes of the free space grid.
        free: [usize; 3],
        /// Nodes of the distance grid.
        nodes: [usize; 3],
    },
    /// No part of the mesh is inside the grid.
    #[error("the mesh lies outside the grid; check the frame it is given in")]
    OutsideGrid,
}

/// Signed distance in meters, negative inside, at the nodes of `nodes` (its values are not read).
///
/// Nodes marked by `free` are outside regardless of the mesh. Parts of the mesh farther than 1.5 spacings
/// outside the grid are ignored. Distances are exact up to rounding within 1.5 spacings of the surface;
/// elsewhere single nodes near the medial axis may be off (on a rough mesh under 1 % of them by more than
/// 0.01 spacings, at most 0.4). The result does not depend on the number of threads.
///
/// # Errors
/// [`DistanceError`], when the mesh or the grids cannot be used.
pub fn signed_distance<T>(
    mesh: &TriangleMesh,
    nodes: &Grid3<T>,
    free: Option<&Grid3<bool>>,
    options: &DistanceOptions,
) -> Result<Grid3<f32>, DistanceError> {
    let origin = nodes.origin;
    let spacing_m = nodes.spacing_m;
    let dims = nodes.dims;
    if dims.iter().any(|&n| n < 2) {
        return Err(DistanceError::TooFewNodes { dims });
    }
    if let Some(free) = free.filter(|f| f.dims != dims) {
        return Err(DistanceError::FreeSpaceShape { free: free.dims, nodes: dims });
    }
    let is_finite: Vec<bool> = mesh.vertices.iter().map(|p| p.iter().all(|c| c.is_finite())).collect();
    let bad = mesh
        .triangles
        .iter()
        .position(|t| !t.iter().all(|i| is_finite.get(*i as usize).copied().unwrap_or_default()));
    if let Some(triangle) = bad {
        return Err(DistanceError::BadTriangle { triangle });
    }
    // Pseudo-normals need triangles with common vertices.
    let mesh = welded_mesh(mesh, 0.0);
    if mesh.is_empty() {
        return Err(DistanceError::EmptyMesh);
    }
    // In spacings from the first node, coordinates are small enough for single precision.
    let positions: Vec<Vector3<f32>> =
        mesh.vertices.iter().map(|p| ((p.cast::<f64>() - origin) / spacing_m).cast::<f32>()).collect();
    let surface = Pseudonormals::of_mesh(&mesh, &positions);
    let nearest = Nearest::of_surface(&surface, dims, options.near_m / spacing_m)?;
    let reach = options.open_reach as f32;
    let is_free = |i: usize| free.is_some_and(|f| f.values[i]);
    let values = at_nodes(dims, |i, at| {
        if nearest.triangle[i] == FAR {
            let side = nearest.band.side[nearest.seed[i] as usize];
            let inside = side.inside && !side.open && !is_free(i);
            let distance = node_position(at).metric_distance(&node_position(seed_at(nearest.seed[i], dims)));
            return spacing_m as f32 * if inside { -distance } else { distance };
        }
        let p = node_position(at);
        let t = nearest.refined_triangle(&surface, i, at) as usize;
        let (q, feature) = closest_on_triangle(&p, &surface.corners[t]);
        let distance = (p - q).norm();
        let beyond = distance > reach && surface.is_open(t, feature);
        // Far from the border of an open mesh, its side means nothing.
        let inside = nearest.is_inside(i) && !beyond && !is_free(i);
        spacing_m as f32 * if inside { -distance } else { distance }
    });
    let mut grid = Grid3 { origin, spacing_m, dims, values };
    if options.solid_cavities {
        fill_cavities(&mut grid, is_free);
    }
    Ok(grid)
}

/// Position of a node in spacings.
fn node_position(at: [usize; 3]) -> Vector3<f32> {
    Vector3::from(at.map(|c| c as f32))
}

/// A value for every node from its index and its x, y, z.
fn at_nodes<V: Send + Default + Clone>(
    [nx, ny, nz]: [usize; 3],
    value: impl Fn(usize, [usize; 3]) -> V + Sync,
) -> Vec<V> {
    let mut values = vec![V::default(); nx * ny * nz];
    values.par_chunks_mut(nx).enumerate().with_min_len(16).for_each(|(row, values)| {
        let y = row % ny;
        let z = row / ny;
        for (x, v) in values.iter_mut().enumerate() {
            *v = value(row * nx + x, [x, y, z]);
        }
    });
    values
}

/// Nearest triangles: exact in the band, candidates elsewhere.
struct Nearest {
    dims: [usize; 3],
    band: Band,
    /// Seed node nearest to each node.
    seed: Vec<u32>,
    /// Nearest triangle of each node; [`FAR`] where none was looked for.
    triangle: Vec<u32>,
}

/// No triangle is looked for: the surface is far.
const FAR: u32 = NO_SEED - 1;

impl Nearest {
    fn of_surface(surface: &Pseudonormals, dims: [usize; 3], near: f64) -> Result<Self, DistanceError> {
        // A seed is at most this far from its surface.
        let near = near + f64::from(SEED);
        let band = Band::of_surface(surface, dims);
        let seed = nearest_seed(dims, &band.seeds);
        // If there is any seed, every node has a nearest one: checking the first node suffices.
        if seed[0] == NO_SEED {
            return Err(DistanceError::OutsideGrid);
        }
        let [nx, ny, nz] = dims;
        let mut triangle = vec![NO_SEED; nx * ny * nz];
        triangle.par_chunks_mut(nx).enumerate().with_min_len(16).for_each(|(row, triangle)| {
            let mut previous = None;
            for (x, t) in triangle.iter_mut().enumerate() {
                let i = row * nx + x;
                *t = band.triangle[i];
                if *t == NO_SEED {
                    let at = [x, row % ny, row / ny];
                    if is_far(at, seed_at(seed[i], dims), near) {
                        (*t, previous) = (FAR, None);
                        continue;
                    }
                    // The closest point of the previous node is at most a spacing away from this one's.
                    let from = band.triangle[seed[i] as usize];
                    *t = surface.nearest_by_walk(&node_position(at), [from, previous.unwrap_or(from)]);
                }
                previous = Some(*t);
            }
        });
        Ok(Self { dims, band, seed, triangle })
    }

    /// Whether a node is inside by the mesh alone. With the seeds within one spacing of the surface, the line
    /// from a node to its nearest seed does not cross the surface: from a seed beyond the crossing, a lattice
    /// step towards the node would lead to a nearer one.
    fn is_inside(&self, i: usize) -> bool {
        let at = if self.band.triangle[i] == NO_SEED { self.seed[i] as usize } else { i };
        self.band.side[at].inside
    }

    /// The nearest triangle among the candidates of a node and of its six neighbors. Neighbors whose triangle
    /// is beside the node's own see the same piece of surface and are skipped.
    fn refined_triangle(&self, surface: &Pseudonormals, i: usize, [x, y, z]: [usize; 3]) -> u32 {
        let own = self.triangle[i];
        if self.band.triangle[i] != NO_SEED {
            return own;
        }
        let [nx, ny, nz] = self.dims;
        let row = nx as isize;
        let layer = (nx * ny) as isize;
        let around = [
            (x > 0, -1),
            (x + 1 < nx, 1),
            (y > 0, -row),
            (y + 1 < ny, row),
            (z > 0, -layer),
            (z + 1 < nz, layer),
        ];
        let place = surface.corners[own as usize][0];
        let p = node_position([x, y, z]);
        let mut best = (f32::INFINITY, own);
        for (_, step) in around.into_iter().filter(|a| a.0) {
            let j = i.wrapping_add_signed(step);
            let t = self.triangle[j];
            if t != own
                && t != FAR
                && t != best.1
                && (surface.corners[t as usize][0] - place).norm_squared() > SAME_PIECE * SAME_PIECE
            {
                // Computed only when needed: most nodes ask no neighbor.
                if best.0 == f32::INFINITY {
                    best.0 = surface.squared_distance(&p, own);
                }
                let d = surface.squared_distance(&p, t);
                if d < best.0 {
                    best = (d, t);
                }
            }
        }
        if best.1 == own { own } else { surface.nearest_by_walk(&p, [best.1; 2]) }
    }
}

/// Grid indices of a seed.
fn seed_at(seed: u32, [nx, ny, _]: [usize; 3]) -> [usize; 3] {
    // Divisions of 32 bits take half as long.
    let row = seed / nx as u32;
    let x = seed % nx as u32;
    [x, row % ny as u32, row / ny as u32].map(|c| c as usize)
}

/// Whether a node is farther than `near` spacings from its nearest seed.
fn is_far(at: [usize; 3], seed: [usize; 3], near: f64) -> bool {
    (0..3).map(|k| (at[k] as f64 - seed[k] as f64).powi(2)).sum::<f64>() > near * near
}

/// The nodes near the surface.
struct Band {
    /// Nearest triangle; [`NO_SEED`] farther than [`BAND`] from the surface.
    triangle: Vec<u32>,
    /// Whether the node passes its triangle on.
    seeds: Vec<bool>,
    /// Side of the surface at the node.
    side: Vec<Side>,
}

/// On which side of the surface a node lies, by its closest point.
#[derive(Clone, Copy, Default)]
struct Side {
    /// Whether it is inside, by the pseudo-normal there.
    inside: bool,
    /// Whether the closest point is on the border of an open mesh.
    open: bool,
}

impl Band {
    fn of_surface(surface: &Pseudonormals, dims: [usize; 3]) -> Self {
        let [nx, ny, nz] = dims;
        let plane = nx * ny;
        let count = nx * ny * nz;
        let mut band = Self {
            triangle: vec![NO_SEED; count],
            seeds: vec![false; count],
            side: vec![Side::default(); count],
        };
        // Each task fills its own layers from the triangles near them.
        let lists = triangles_of_tasks(surface, nz.div_ceil(LAYERS_PER_TASK));
        let size = plane * LAYERS_PER_TASK;
        let chunks = band
            .triangle
            .par_chunks_mut(size)
            .zip(band.seeds.par_chunks_mut(size))
            .zip(band.side.par_chunks_mut(size));
        chunks.zip(lists).enumerate().for_each(|(task, (((triangle, seeds), side), list))| {
            let first = task * LAYERS_PER_TASK;
            let mut distance2 = vec![BAND * BAND; triangle.len()];
            for t in list {
                visit_band(
                    surface,
                    t as usize,
                    [nx, ny, first + triangle.len() / plane],
                    first,
                    |[x, y, z], away, feature| {
                        let i = (z - first) * plane + y * nx + x;
                        let d2 = away.norm_squared();
                        if d2 < distance2[i] {
                            distance2[i] = d2;
                            triangle[i] = t;
                            side[i] = Side {
                                inside: away.dot(&surface.feature_normal(t as usize, feature)) < 0.0,
                                open: surface.is_open(t as usize, feature),
                            };
                        }
                    },
                );
            }
            for (seed, d2) in seeds.iter_mut().zip(&distance2) {
                *seed = *d2 <= SEED * SEED;
            }
        });
        band
    }
}

/// For each task, the triangles whose band reaches its layers, ascending.
fn triangles_of_tasks(surface: &Pseudonormals, tasks: usize) -> Vec<Vec<u32>> {
    let mut lists = vec![Vec::new(); tasks];
    for (t, corners) in surface.corners.iter().enumerate() {
        let low = corners.iter().map(|c| c.z).fold(f32::INFINITY, f32::min) - BAND;
        let high = corners.iter().map(|c| c.z).fold(f32::NEG_INFINITY, f32::max) + BAND;
        if high < 0.0 {
            continue;
        }
        let from = (low.max(0.0) as usize) / LAYERS_PER_TASK;
        let to = (high as usize / LAYERS_PER_TASK).min(tasks - 1);
        for list in lists.iter_mut().take(to + 1).skip(from) {
            list.push(t as u32);
        }
    }
    lists
}

/// Calls `visit` with each node near the band of a triangle in layers `first..end[2]`, the node's offset from
/// its closest point, and the feature on which this point lies.
fn visit_band(
    surface: &Pseudonormals,
    t: usize,
    end: [usize; 3],
    first: usize,
    mut visit: impl FnMut([usize; 3], Vector3<f32>, Feature),
) {
    let corners = &surface.corners[t];
    let [a, b, c] = corners;
    let low = a.inf(b).inf(c).add_scalar(-BAND);
    let high = a.sup(b).sup(c).add_scalar(BAND);
    let normal = surface.face_normal(t);
    for z in nodes_between(low.z, high.z, first, end[2]) {
        for y in nodes_between(low.y, high.y, 0, end[1]) {
            let mut row = nodes_between(low.x, high.x, 0, end[0]);
            // Only nodes within the band of the triangle's plane.
            let height = normal.y * (y as f32 - a.y) + normal.z * (z as f32 - a.z) - normal.x * a.x;
            // Some slack for rounding: a node too many costs one distance, one too few gives a wrong value.
            if normal.x.abs() > 1e-3 {
                let u = (-BAND - height) / normal.x;
                let v = (BAND - height) / normal.x;
                row.start = row.start.max((u.min(v) - 0.01).ceil().max(0.0) as usize);
                row.end = row.end.min((u.max(v) + 1.01).floor().max(0.0) as usize);
            } else if height.abs() > BAND + 0.01 + 1e-3 * end[0] as f32 {
                continue;
            }
            for x in row {
                let p = Vector3::new(x as f32, y as f32, z as f32);
                let (q, feature) = closest_on_triangle(&p, corners);
                visit([x, y, z], p - q, feature);
            }
        }
    }
}

/// Nodes of `first..end` along an axis between two coordinates.
fn nodes_between(low: f32, high: f32, first: usize, end: usize) -> Range<usize> {
    (low.ceil().max(first as f32) as usize)..((high.floor() + 1.0).clamp(0.0, end as f32) as usize)
}

/// Turns outside nodes inside unless they are connected to the border of the grid or to free space.
fn fill_cavities(grid: &mut Grid3<f32>, is_free: impl Fn(usize) -> bool) {
    let [nx, ny, nz] = grid.dims;
    let plane = nx * ny;
    // Outside spreads from the border and from seen empty space; the rest is enclosed.
    let mut reached = vec![false; grid.values.len()];
    let mut open = Vec::new();
    for (i, value) in grid.values.iter().enumerate() {
        let x = i % nx;
        let y = i / nx % ny;
        let z = i / plane;
        let at_border = x == 0 || y == 0 || z == 0 || x + 1 == nx || y + 1 == ny || z + 1 == nz;
        if *value >= 0.0 && (at_border || is_free(i)) {
            reached[i] = true;
            open.push(i);
        }
    }
    while let Some(i) = open.pop() {
        let x = i % nx;
        let y = i / nx % ny;
        let z = i / plane;
        let neighbors = [
            (x > 0).then(|| i - 1),
            (x + 1 < nx).then(|| i + 1),
            (y > 0).then(|| i - nx),
            (y + 1 < ny).then(|| i + nx),
            (z > 0).then(|| i - plane),
            (z + 1 < nz).then(|| i + plane),
        ];
        for j in neighbors.into_iter().flatten() {
            if !reached[j] && grid.values[j] >= 0.0 {
                reached[j] = true;
                open.push(j);
            }
        }
    }
    for (value, reached) in grid.values.iter_mut().zip(reached) {
        if !reached {
            *value = -value.abs();
        }
    }
}

#[cfg(test)]
#[path = "distance_tests.rs"]
mod tests;
