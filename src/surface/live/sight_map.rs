//! How many views saw each cell of space empty, and filled; stored in blocks of cells.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::{
    clearance::{Clearance, SpaceState},
    view_depth::ViewDepth,
};
use crate::rows::RowCamera;
use capture::cell_of_point;

/// Cells along a side of a block; a layer of cells fills the bits of a word.
pub(super) const SIDE: usize = 8;
/// Position of a block: its first cell, in block sides.
type Key = [i32; 3];
/// A bit for every cell of a block: words by z, bits by `x + 8 y`.
type Bits = [u64; SIDE];

/// For each cell of a block, how many views saw it empty, and filled. Each number is stored as one bit plane
/// per binary digit, the lowest first.
#[derive(Clone, Default)]
struct BlockSight {
    empty: [Bits; 3],
    filled: [Bits; 2],
}

/// How many views saw a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct SightCount {
    /// Number of views that saw it empty, at most 7.
    pub empty: u8,
    /// Number of views that saw something in or beside it, at most 3.
    pub filled: u8,
}

impl BlockSight {
    fn count_at(&self, cell: [usize; 3]) -> SightCount {
        SightCount { empty: number_at(&self.empty, cell), filled: number_at(&self.filled, cell) }
    }

    fn set_count(&mut self, cell: [usize; 3], seen: SightCount) {
        set_number(&mut self.empty, cell, seen.empty);
        set_number(&mut self.filled, cell, seen.filled);
    }
}

/// The number of a cell, from bit planes with the lowest digit first.
fn number_at(digits: &[Bits], [x, y, z]: [usize; 3]) -> u8 {
    digits.iter().rev().fold(0, |n, bits| 2 * n + (bits[z] >> (x + SIDE * y) & 1) as u8)
}

/// Sets the number of a cell; it must be zero before.
fn set_number(digits: &mut [Bits], [x, y, z]: [usize; 3], number: u8) {
    for (k, bits) in digits.iter_mut().enumerate() {
        bits[z] |= u64::from(number >> k & 1) << (x + SIDE * y);
    }
}

/// Adds one to the cells whose bit in `more` is set, unless their number is at its maximum.
fn count_one_more(digits: &mut [Bits], z: usize, more: u64) {
    let full = digits.iter().fold(u64::MAX, |all, bits| all & bits[z]);
    let mut carry = more & !full;
    for bits in digits {
        (bits[z], carry) = (bits[z] ^ carry, bits[z] & carry);
    }
}

/// Space by how views saw it.
pub(super) struct SightMap {
    cell_m: f64,
    blocks: BTreeMap<Key, BlockSight>,
}

/// What one view saw of a block.
pub(super) struct Look {
    key: Key,
    empty: Bits,
    filled: Bits,
}

impl SightMap {
    /// An empty map.
    pub(super) fn new(cell_m: f64) -> Self {
        Self { cell_m, blocks: BTreeMap::new() }
    }

    /// Side of a cell, meters.
    pub(super) fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// Memory of this many blocks, bytes.
    pub(super) fn bytes_of(blocks: usize) -> usize {
        // The factor is for free places of the tree.
        blocks * (size_of::<(Key, BlockSight)>() * 3 / 2)
    }

    /// Memory in use, bytes.
    pub(super) fn bytes(&self) -> usize {
        Self::bytes_of(self.blocks.len())
    }

    /// What a view saw of each block, and the number of new blocks.
    pub(super) fn looks_of_view(&self, view: &ViewDepth, clearance: &Clearance) -> (Vec<Look>, usize) {
        let block_m = self.cell_m * SIDE as f64;
        let radius_m = (0.5 * 3f64.sqrt() * block_m) as f32;
        let [low, high] = self.block_range(view, f64::from(clearance.sight_m));
        let first = Point3::from(low.map(|k| (f64::from(k) + 0.5) * block_m));
        let intrinsics = &view.frame.intrinsics;
        let camera = RowCamera::new(intrinsics, &view.camera_from_world, &first, block_m);
        let count = [0, 1, 2].map(|k| (high[k] - low[k] + 1).max(0) as usize);
        let mut looks = Vec::new();
        for (y, z) in (0..count[2]).flat_map(|z| (0..count[1]).map(move |y| (y, z))) {
            let row = camera.row_in_image(y, z, count[0]);
            // A block may reach into the image though its center is outside.
            let range = row.range.start.saturating_sub(1)..(row.range.end + 1).min(count[0]);
            for x in range.filter(|_| !row.range.is_empty()) {
                let middle = row.at(x);
                if middle.z - radius_m > clearance.sight_m {
                    continue;
                }
                let key = [low[0] + x as i32, low[1] + y as i32, low[2] + z as i32];
                match clearance.state_of_ball(&middle, radius_m, 0.0) {
                    SpaceState::Nothing => {}
                    SpaceState::Empty => looks.push(Look { key, empty: [u64::MAX; SIDE], filled: [0; SIDE] }),
                    SpaceState::Mixed => looks.extend(self.look_in_detail(key, view, clearance)),
                }
            }
        }
        let new = looks.iter().filter(|l| !self.blocks.contains_key(&l.key)).count();
        (looks, new)
    }

    /// Adds what a view saw of its blocks.
    pub(super) fn add_looks(&mut self, looks: &[Look]) {
        for look in looks {
            let sight = self.blocks.entry(look.key).or_default();
            for z in 0..SIDE {
                count_one_more(&mut sight.empty, z, look.empty[z]);
                count_one_more(&mut sight.filled, z, look.filled[z]);
            }
        }
    }

    /// First and last block of the bounding box of a view's frustum.
    fn block_range(&self, view: &ViewDepth, farthest_m: f64) -> [Key; 2] {
        let block_m = self.cell_m * SIDE as f64;
        let k = &view.frame.intrinsics;
        let corners = [(0, 0), (k.width, 0), (0, k.height), (k.width, k.height)];
        let far = corners.map(|(u, v)| {
            let ray = view.frame.world_from_camera * k.ray_at(u as f64 - 0.5, v as f64 - 0.5);
            view.eye() + ray * farthest_m
        });
        let ends = far.iter().fold([view.eye(), view.eye()], |[low, high], p| [low.inf(p), high.sup(p)]);
        // A wrong camera model may have an unbounded frustum: the box is limited around the camera.
        let reach = Vector3::repeat(2.0 * farthest_m);
        let cut = [ends[0].sup(&(view.eye() - reach)), ends[1].inf(&(view.eye() + reach))];
        let keys = cut.map(|p| cell_of_point(&p, block_m));
        match keys {
            [Some(low), Some(high)] => [low, high],
            _ => [[0; 3], [-1; 3]],
        }
    }

    fn look_in_detail(&self, key: Key, view: &ViewDepth, clearance: &Clearance) -> Option<Look> {
        let first = Point3::from(key.map(|k| (f64::from(k) * SIDE as f64 + 0.5) * self.cell_m));
        let camera = RowCamera::new(&view.frame.intrinsics, &view.camera_from_world, &first, self.cell_m);
        let mut look = Look { key, empty: [0; SIDE], filled: [0; SIDE] };
        for z in 0..SIDE {
            for y in 0..SIDE {
                let row = camera.row_in_image(y, z, SIDE);
                for x in row.range.clone() {
                    let p = row.at(x);
                    let bit = 1 << (x + SIDE * y);
                    match clearance.is_filled(camera.pixel_of(&p), p.z) {
                        Some(false) => look.empty[z] |= bit,
                        Some(true) => look.filled[z] |= bit,
                        None => {}
                    }
                }
            }
        }
        (0..SIDE).any(|z| look.empty[z] | look.filled[z] != 0).then_some(look)
    }

    /// How many views saw the cell at a point.
    pub(super) fn count_at_point(&self, point: &Point3<f64>) -> SightCount {
        cell_of_point(point, self.cell_m).map_or_else(SightCount::default, |c| self.count_of_cell(c))
    }

    /// How many views saw a cell.
    pub(super) fn count_of_cell(&self, cell: [i32; 3]) -> SightCount {
        let side = SIDE as i32;
        let sight = self.blocks.get(&cell.map(|c| c.div_euclid(side)));
        sight.map_or_else(SightCount::default, |s| s.count_at(cell.map(|c| c.rem_euclid(side) as usize)))
    }

    /// Calls `take` with every cell of the seen blocks between two blocks.
    pub(super) fn for_each_cell(
        &self,
        [low, high]: [[i32; 3]; 2],
        mut take: impl FnMut([i32; 3], SightCount),
    ) {
        let side = SIDE as i32;
        let [first, last] = [low, high].map(|c| c.map(|v| v.div_euclid(side)));
        for z in first[2]..=last[2] {
            for y in first[1]..=last[1] {
                for x in first[0]..=last[0] {
                    let Some(sight) = self.blocks.get(&[x, y, z]) else { continue };
                    for i in 0..SIDE * SIDE * SIDE {
                        let within = [i % SIDE, i / SIDE % SIDE, i / SIDE / SIDE];
                        let block = [x, y, z];
                        let cell = [0, 1, 2].map(|k| block[k] * side + within[k] as i32);
                        take(cell, sight.count_at(within));
                    }
                }
            }
        }
    }

    /// Doubles the cell size. A new cell counts as seen empty as often as all of its eight old cells, and as
    /// seen filled as often as any.
    pub(super) fn coarsen(&mut self) {
        let old = std::mem::take(&mut self.blocks);
        for (key, fine) in old {
            let coarse = self.blocks.entry(key.map(|k| k.div_euclid(2))).or_default();
            let at = key.map(|k| k.rem_euclid(2) as usize * SIDE / 2);
            for i in 0..SIDE * SIDE * SIDE / 8 {
                let half = [i % 4, i / 4 % 4, i / 16];
                let eight = (0..8).map(|c| fine.count_at([0, 1, 2].map(|k| 2 * half[k] + (c >> k & 1))));
                let seen = eight.reduce(|a, b| SightCount {
                    empty: a.empty.min(b.empty),
                    filled: a.filled.max(b.filled),
                });
                coarse.set_count([0, 1, 2].map(|k| at[k] + half[k]), seen.unwrap_or_default());
            }
        }
        self.cell_m *= 2.0;
    }
}
