//! A sparse truncated signed distance volume: it has blocks of nodes only where surfaces were read.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::{
    clearance::{Clearance, SpaceState},
    view_depth::ViewDepth,
};
use crate::{
    rows::RowCamera,
    tsdf_view::{FREE_WEIGHT, NodeReading, behind_weight, reading_of_node},
};
use capture::cell_of_point;
use geometry::Grid3;

/// Nodes along a side of a block.
pub(super) const SIDE: usize = 8;
const NODES: usize = SIDE * SIDE * SIDE;
/// A block is drawn again when its surface has moved by this part of a spacing, on average, since it was last
/// drawn. chosen: nodes are no finer than pixels of the views, and a quarter of a pixel is not seen
const VISIBLE: f32 = 0.25;

/// Position of a block: its first node, in block sides.
pub(super) type Key = [i32; 3];

/// Weighted means at the nodes of a block; x varies fastest.
struct Block {
    distance_m: [f32; NODES],
    weight: [f32; NODES],
    /// Red, green, blue, number of readings.
    color: [[u8; 4]; NODES],
    /// Change of its surface since it was last drawn, meters.
    pending_m: f32,
}

impl Block {
    fn boxed_empty() -> Box<Self> {
        Box::new(Self {
            distance_m: [0.0; NODES],
            weight: [0.0; NODES],
            color: [[0; 4]; NODES],
            pending_m: 0.0,
        })
    }

    /// Adds a distance to the mean of a node. Returns by how much a surface there moved, meters; `None` where
    /// none is near.
    fn take_distance(&mut self, node: usize, distance_m: f32, weight: f32, near_m: f32) -> Option<f32> {
        let old_m = self.distance_m[node];
        let old = self.weight[node];
        let new_m = old_m + (distance_m - old_m) * weight / (old + weight);
        self.distance_m[node] = new_m;
        self.weight[node] = old + weight;
        match old {
            0.0 => (new_m.abs() < near_m).then_some(near_m),
            _ => (old_m.abs().min(new_m.abs()) < near_m).then_some((new_m - old_m).abs()),
        }
    }

    fn take_color(&mut self, node: usize, color: [u8; 3]) {
        let [r, g, b, count] = self.color[node];
        let n = f32::from(count);
        let mean = |old: u8, new: u8| ((f32::from(old) * n + f32::from(new)) / (n + 1.0)).round() as u8;
        self.color[node] = [mean(r, color[0]), mean(g, color[1]), mean(b, color[2]), count.saturating_add(1)];
    }
}

/// The blocks of a map.
pub(super) struct BlockMap {
    spacing_m: f64,
    truncation_m: f64,
    blocks: BTreeMap<Key, Box<Block>>,
}

impl BlockMap {
    /// An empty map.
    pub(super) fn new(spacing_m: f64, truncation_m: f64) -> Self {
        Self { spacing_m, truncation_m, blocks: BTreeMap::new() }
    }

    /// Distance between nodes, meters.
    pub(super) fn spacing_m(&self) -> f64 {
        self.spacing_m
    }

    /// Memory of this many blocks, bytes.
    pub(super) fn bytes_of(blocks: usize) -> usize {
        // The second term is for keys, pointers and free places of the tree.
        blocks * (size_of::<Block>() + 48)
    }

    /// Memory in use, bytes.
    pub(super) fn bytes(&self) -> usize {
        Self::bytes_of(self.blocks.len())
    }

    /// Keys of the blocks around a view's surface, sorted, and the number of new ones.
    pub(super) fn blocks_about(&self, view: &ViewDepth) -> (Vec<Key>, usize) {
        let k = &view.frame.intrinsics;
        let block_m = self.spacing_m * SIDE as f64;
        // Rays a third of a block apart miss only corners of blocks, and other views hit these.
        let step = ((block_m / 3.0 / view.pixel_m(view.median_m)) as usize).clamp(1, 8);
        let mut keys = Vec::new();
        for v in (0..k.height).step_by(step) {
            for u in (0..k.width).step_by(step) {
                let r = view.readings[v * k.width + u];
                if !r.is_surface() {
                    continue;
                }
                let ray = view.frame.world_from_camera * k.ray_at(u as f64, v as f64);
                let steps = (2.0 * self.truncation_m / (0.5 * block_m)).ceil();
                for i in 0..=steps as usize {
                    let along = i as f64 / steps * 2.0 - 1.0;
                    let point = view.eye() + ray * (f64::from(r.depth_m) + along * self.truncation_m);
                    if let Some(key) = cell_of_point(&point, block_m).filter(|key| keys.last() != Some(key)) {
                        keys.push(key);
                    }
                }
            }
        }
        keys.sort_unstable();
        keys.dedup();
        let new = keys.iter().filter(|key| !self.blocks.contains_key(*key)).count();
        (keys, new)
    }

    /// Creates the blocks that do not exist yet.
    pub(super) fn allocate(&mut self, keys: &[Key]) {
        for key in keys {
            self.blocks.entry(*key).or_insert_with(Block::boxed_empty);
        }
    }

    /// Fuses a view into all its blocks; returns those that changed visibly, sorted.
    pub(super) fn integrate(&mut self, view: &ViewDepth, clearance: &Clearance) -> Vec<Key> {
        let spacing_m = self.spacing_m;
        let truncation_m = self.truncation_m as f32;
        let half_m = 0.5 * (SIDE - 1) as f64 * spacing_m;
        let radius_m = (3f64.sqrt() * half_m) as f32;
        let near_m = 2.0 * spacing_m as f32;
        let intrinsics = &view.frame.intrinsics;
        let mut changed = Vec::new();
        for (key, block) in &mut self.blocks {
            let first = Point3::from(key.map(|k| f64::from(k) * SIDE as f64 * spacing_m));
            let center = view.camera_from_world * (first + Vector3::repeat(half_m));
            if clearance.state_of_ball(&center.coords.cast(), radius_m, truncation_m) == SpaceState::Nothing {
                continue;
            }
            let camera = RowCamera::new(intrinsics, &view.camera_from_world, &first, spacing_m);
            let mut sum_m = 0.0f32;
            let mut count = 0;
            for (y, z) in (0..SIDE).flat_map(|z| (0..SIDE).map(move |y| (y, z))) {
                let row = camera.row_in_image(y, z, SIDE);
                for x in row.range.clone() {
                    let node = x + SIDE * (y + SIDE * z);
                    let change_m = match reading_of_node(
                        &view.readings,
                        intrinsics,
                        &camera,
                        &row.at(x),
                        truncation_m,
                    ) {
                        None => None,
                        // Free space weighs the same, however far behind it the reading is.
                        Some(NodeReading::Free { .. }) => {
                            block.take_distance(node, truncation_m, FREE_WEIGHT, near_m)
                        }
                        Some(NodeReading::Near { s, weight, pixel }) => {
                            if s.abs() < 1.0 {
                                block.take_color(node, view.frame.rgb[pixel]);
                            }
                            let weight = weight * behind_weight(s, 1.0);
                            block.take_distance(node, s.min(1.0) * truncation_m, weight, near_m)
                        }
                    };
                    sum_m += change_m.unwrap_or(0.0);
                    count += i32::from(change_m.is_some());
                }
            }
            block.pending_m += sum_m / count.max(1) as f32;
            if block.pending_m > VISIBLE * spacing_m as f32 {
                block.pending_m = 0.0;
                changed.push(*key);
            }
        }
        changed
    }

    /// Doubles the spacing: every second node stays where it is, with its values.
    pub(super) fn coarsen(&mut self, truncation_m: f64) {
        let old = std::mem::take(&mut self.blocks);
        let old_m = self.spacing_m as f32;
        for (key, fine) in old {
            let parent = key.map(|k| k.div_euclid(2));
            let coarse = self.blocks.entry(parent).or_insert_with(Block::boxed_empty);
            let at = key.map(|k| k.rem_euclid(2) as usize * SIDE / 2);
            for i in 0..NODES / 8 {
                let half = [i % 4, i / 4 % 4, i / 16];
                let from = index(half.map(|h| 2 * h));
                let to = index([0, 1, 2].map(|k| at[k] + half[k]));
                // The known space behind a surface is thinner than a coarse cell: the value comes from the
                // next node.
                let known = if fine.weight[from] > 0.0 {
                    Some((fine.distance_m[from], fine.weight[from], fine.color[from]))
                } else {
                    neighbors_in_block(half.map(|h| 2 * h))
                        .map(index)
                        .filter(|n| fine.weight[*n] > 0.0 && fine.distance_m[*n] < 0.0)
                        .map(|n| (fine.distance_m[n] - old_m, fine.weight[n], fine.color[n]))
                        .next()
                };
                if let Some(known) = known {
                    (coarse.distance_m[to], coarse.weight[to], coarse.color[to]) = known;
                }
            }
        }
        self.spacing_m *= 2.0;
        self.truncation_m = truncation_m;
    }

    /// Keys of all blocks, sorted.
    pub(super) fn keys(&self) -> impl Iterator<Item = &Key> {
        self.blocks.keys()
    }

    /// Distances (NaN where nothing is known) and colors of every `stride`th node in the cells of some
    /// blocks, `side` blocks along each axis from `first`.
    pub(super) fn grid_of_blocks(
        &self,
        first: Key,
        side: usize,
        stride: usize,
    ) -> (Grid3<f32>, Vec<[u8; 4]>) {
        let nodes = side * SIDE / stride + 1;
        let count = nodes * nodes * nodes;
        let corner = Point3::from(first.map(|k| f64::from(k) * SIDE as f64 * self.spacing_m));
        let mut grid = Grid3 {
            origin: corner,
            spacing_m: self.spacing_m * stride as f64,
            dims: [nodes; 3],
            values: vec![f32::NAN; count],
        };
        let mut colors = vec![[0; 4]; count];
        let along = side + 1;
        for i in 0..along * along * along {
            let [bx, by, bz] = [i % along, i / along % along, i / along / along];
            let place = [first[0] + bx as i32, first[1] + by as i32, first[2] + bz as i32];
            let Some(block) = self.blocks.get(&place) else { continue };
            // Of the next blocks only the first layer is taken: it closes the cells.
            let range = |b: usize| (0..if b == side { 1 } else { SIDE }).step_by(stride);
            for (z, y) in range(bz).flat_map(|z| range(by).map(move |y| (z, y))) {
                for x in range(bx) {
                    let node = index([x, y, z]);
                    if block.weight[node] > 0.0 {
                        let to = grid.index(
                            (bx * SIDE + x) / stride,
                            (by * SIDE + y) / stride,
                            (bz * SIDE + z) / stride,
                        );
                        grid.values[to] = block.distance_m[node];
                        colors[to] = block.color[node];
                    }
                }
            }
        }
        (grid, colors)
    }
}

fn index([x, y, z]: [usize; 3]) -> usize {
    x + SIDE * (y + SIDE * z)
}

/// The six neighbors of a node in its block.
fn neighbors_in_block(node: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..3).flat_map(move |axis| {
        [-1isize, 1].into_iter().filter_map(move |step| {
            let mut other = node;
            other[axis] = node[axis].checked_add_signed(step).filter(|n| *n < SIDE)?;
            Some(other)
        })
    })
}
