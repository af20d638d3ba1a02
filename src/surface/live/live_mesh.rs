//! The surface of the map in chunks; only changed chunks are made again.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

use nalgebra::Point3;

use super::block_map::{self, BlockMap, Key};
use crate::{TriangleMesh, marching_cubes};

/// Blocks along a side of a chunk.
const BLOCKS: i32 = 2;
/// Largest number of triangles in all; above it nodes are skipped, at first outside the ball of the views.
/// derived: 3.6 MB as markers; a local network carries them within a second beside the images
const MOST_TRIANGLES: usize = 30_000;
/// With this many times fewer triangles, skipped nodes are taken in again.
/// derived: half the spacing makes four times the triangles, and noise some more
const FEWER: usize = 6;
/// The ball of the views counts as another one when it moved or grew by this part of its radius.
/// chosen: a tenth of an image
const OTHER_BALL: f64 = 0.1;
/// Largest step from one used node to the next.
/// derived: behind a surface four spacings are known, a cell must not be wider
const LARGEST_STRIDE: usize = 4;
/// Color where none was read.
const GRAY: [u8; 3] = [128; 3];

/// A part of the surface.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshChunk {
    /// Permanent number of the chunk.
    pub id: i32,
    /// Version of the whole mesh in which the chunk last changed.
    pub version: u64,
    /// The surface, with colors, in the world.
    pub mesh: TriangleMesh,
}

/// The surface of a map.
#[derive(Default)]
pub(super) struct LiveMesh {
    /// Step from one used node to the next, within the ball of the views and outside it.
    strides: [usize; 2],
    /// Center and radius (meters) of the ball of the views.
    ball: Option<(Point3<f64>, f64)>,
    chunks: BTreeMap<Key, Arc<MeshChunk>>,
    stale: BTreeSet<Key>,
    next_id: i32,
    version: u64,
    triangles: usize,
}

impl LiveMesh {
    /// An empty surface.
    pub(super) fn new() -> Self {
        Self { strides: [1, 1], ..Self::default() }
    }

    /// Marks the surface in some blocks as changed.
    pub(super) fn mark_changed(&mut self, blocks: &[Key]) {
        for key in blocks {
            // The cells of a block end at the first nodes of the next.
            for corner in 0..8 {
                let below = [0, 1, 2].map(|k| (key[k] - (corner >> k & 1)).div_euclid(BLOCKS));
                self.stale.insert(below);
            }
        }
    }

    /// Forgets all chunks, because the blocks have changed. Numbers go on: no new chunk gets the number of an
    /// old one.
    fn begin_again(&mut self, map: &BlockMap) {
        self.chunks.clear();
        self.triangles = 0;
        let keys: Vec<Key> = map.keys().copied().collect();
        self.mark_changed(&keys);
    }

    /// The same after the map's spacing doubled: at least as many nodes are used as before.
    pub(super) fn begin_coarser(&mut self, map: &BlockMap) {
        self.strides = self.strides.map(|s| (s / 2).max(1));
        self.begin_again(map);
    }

    /// Makes the stale chunks again; `ball` is the ball of the views (center and radius, meters).
    pub(super) fn refresh(&mut self, map: &BlockMap, ball: Option<(Point3<f64>, f64)>) {
        let is_other = match (self.ball, ball) {
            (Some((a, r)), Some((b, s))) => (a - b).norm().max((r - s).abs()) > OTHER_BALL * r,
            (a, b) => a.is_some() != b.is_some(),
        };
        if is_other {
            self.ball = ball;
            self.begin_again(map);
        }
        self.remake_stale(map);
        let coarsest = self.strides.iter().position(|s| *s > 1);
        if let Some(finer) = coarsest.filter(|_| FEWER * self.triangles < MOST_TRIANGLES) {
            self.strides[finer] /= 2;
            self.begin_again(map);
            self.remake_stale(map);
        }
        while self.triangles > MOST_TRIANGLES {
            let Some(coarser) = [1, 0].into_iter().find(|k| self.strides[*k] < LARGEST_STRIDE) else { break };
            self.strides[coarser] *= 2;
            self.begin_again(map);
            self.remake_stale(map);
        }
    }

    /// Step from one used node to the next in a chunk.
    fn stride_of(&self, map: &BlockMap, key: Key) -> usize {
        let side_m = f64::from(BLOCKS) * block_map::SIDE as f64 * map.spacing_m();
        let middle = Point3::from(key.map(|k| (f64::from(k) + 0.5) * side_m));
        let is_near = self.ball.is_none_or(|(center, radius_m)| (middle - center).norm() < radius_m + side_m);
        self.strides[usize::from(!is_near)]
    }

    fn remake_stale(&mut self, map: &BlockMap) {
        self.version += 1;
        for key in std::mem::take(&mut self.stale) {
            let mesh = self.mesh_of_chunk(map, key);
            let known = self.chunks.get(&key);
            self.triangles -= known.map_or(0, |c| c.mesh.triangles.len());
            self.triangles += mesh.triangles.len();
            let id = known.map(|c| c.id);
            // A chunk that lost its surface stays, empty, so viewers remove it.
            if mesh.is_empty() && id.is_none() {
                continue;
            }
            let id = id.unwrap_or_else(|| {
                self.next_id += 1;
                self.next_id
            });
            self.chunks.insert(key, Arc::new(MeshChunk { id, version: self.version, mesh }));
        }
    }

    fn mesh_of_chunk(&self, map: &BlockMap, key: Key) -> TriangleMesh {
        let (grid, colors) =
            map.grid_of_blocks(key.map(|k| k * BLOCKS), BLOCKS as usize, self.stride_of(map, key));
        let mut mesh = marching_cubes(&grid, 0.0);
        let last = grid.dims[0] - 1;
        mesh.colors = mesh
            .vertices
            .iter()
            .map(|p| {
                let at = (p.cast::<f64>() - grid.origin) / grid.spacing_m;
                // The two ends of the vertex's edge, the nearer one first.
                let near = at.map(|v| (v.round().max(0.0) as usize).min(last));
                let far = at.zip_map(&near, |v, n| {
                    let other = if v > n as f64 { v.ceil() } else { v.floor() };
                    // Single precision leaves a vertex slightly off its edge.
                    if (v - n as f64).abs() < 1e-3 { n } else { (other.max(0.0) as usize).min(last) }
                });
                let ends = [near, far].map(|n| colors[grid.index(n.x, n.y, n.z)]);
                match ends.into_iter().find(|c| c[3] > 0) {
                    Some([r, g, b, _]) => [r, g, b],
                    None => GRAY,
                }
            })
            .collect();
        mesh
    }

    /// All chunks, ordered by position.
    pub(super) fn chunks(&self) -> impl Iterator<Item = &Arc<MeshChunk>> {
        self.chunks.values()
    }

    /// Width of the cells within the ball of the views, in spacings of the map.
    pub(super) fn stride(&self) -> usize {
        self.strides[0]
    }
}

const _: () = assert!(block_map::SIDE.is_multiple_of(LARGEST_STRIDE));
