//! The samples of a batch with a loss, arranged in blocks.

use std::ops::Range;

use super::simd::{COLUMN_ALIGN, PointColumns};
use super::{SampleBatch, SdfTarget};

/// Target number of points per block, whose activations then fit in the second-level cache.
const BLOCK_POINTS: usize = 256;
/// Number of groups of blocks, whatever the number of threads; every group sums its own gradient.
const GROUPS: usize = 32;

/// Whole rays that are computed together. Columns `start..start + len` hold samples, the rest up to `cols` is
/// padding.
#[derive(Clone, Debug)]
pub(super) struct Block {
    pub start: usize,
    pub len: usize,
    pub cols: usize,
    #[cfg_attr(not(test), expect(dead_code, reason = "the tests check it"))]
    pub rays: Range<usize>,
}

/// The samples with a loss, as columns; blocks start at multiples of 16.
pub(super) struct Plan {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    /// Sample of every column; padding repeats the last one.
    pub sample: Vec<u32>,
    pub blocks: Vec<Block>,
    /// Ranges of blocks; they depend on the batch only.
    pub groups: Vec<Range<usize>>,
}

impl Plan {
    /// Leaves out samples without TSDF supervision and color weight.
    ///
    /// # Panics
    /// If the lengths of the batch's vectors do not match its counts.
    pub(crate) fn new(batch: &SampleBatch) -> Self {
        let rays = batch.rays;
        let per_ray = batch.samples_per_ray;
        let n = rays * per_ray;
        assert!(
            batch.points.len() == n && batch.targets.len() == n && batch.color_weights.len() == n,
            "a batch of {rays} x {per_ray}"
        );
        assert!(
            batch.directions.len() == rays && batch.colors.len() == rays && batch.ray_weights.len() == rays,
            "a batch of {rays} rays"
        );
        assert!(u32::try_from(n).is_ok(), "{n} samples in a batch");
        let mut sample: Vec<u32> = Vec::with_capacity(n + n / 8 + COLUMN_ALIGN);
        let mut blocks: Vec<Block> = Vec::new();
        let mut start = 0;
        let mut first_ray = 0;
        // One extra round closes the last block.
        for ray in 0..=rays {
            let before = sample.len();
            if ray < rays {
                let range = ray * per_ray..(ray + 1) * per_ray;
                sample.extend(
                    range
                        .filter(|&i| batch.targets[i] != SdfTarget::Ignore || batch.color_weights[i] != 0.0)
                        .map(|i| i as u32),
                );
                // A ray with more samples than a block gets a block of its own, since its color sums over
                // all.
                if sample.len() - start <= BLOCK_POINTS || before == start {
                    continue;
                }
            }
            // The previous rays form a block; this ray's samples move behind its padding.
            let len = before - start;
            if len > 0 {
                let cols = len.next_multiple_of(COLUMN_ALIGN);
                let last = sample[before - 1];
                sample.splice(before..before, std::iter::repeat_n(last, cols - len));
                blocks.push(Block { start, len, cols, rays: first_ray..ray });
                start += cols;
            }
            first_ray = ray;
        }
        let [x, y, z] = [0, 1, 2].map(|k| sample.iter().map(|&i| batch.points[i as usize][k]).collect());
        let per_group = blocks.len().div_ceil(GROUPS).max(1);
        let groups =
            (0..blocks.len()).step_by(per_group).map(|b| b..(b + per_group).min(blocks.len())).collect();
        Self { x, y, z, sample, blocks, groups }
    }

    /// Number of columns, with padding.
    pub(crate) fn column_count(&self) -> usize {
        self.sample.len()
    }

    pub(crate) fn point_columns(&self) -> PointColumns<'_> {
        PointColumns { x: &self.x, y: &self.y, z: &self.z }
    }

    /// Number of columns of the largest block.
    pub(crate) fn widest_block(&self) -> usize {
        self.blocks.iter().map(|b| b.cols).max().unwrap_or(0)
    }

    /// Range of columns of a group of blocks.
    pub(crate) fn group_columns(&self, group: &Range<usize>) -> Range<usize> {
        let last = &self.blocks[group.end - 1];
        self.blocks[group.start].start..last.start + last.cols
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn batch(rays: usize, per_ray: usize, active: impl Fn(usize) -> bool) -> SampleBatch {
        let n = rays * per_ray;
        let target =
            |i| if active(i) { SdfTarget::Empty { value: 1.0, weight: 1.0 } } else { SdfTarget::Ignore };
        SampleBatch {
            rays,
            samples_per_ray: per_ray,
            points: (0..n).map(|i| [i as f32, 0.5, 0.25]).collect(),
            targets: (0..n).map(target).collect(),
            color_weights: vec![0.0; n],
            directions: vec![[0.0, 0.0, 1.0]; rays],
            colors: vec![[0.0; 3]; rays],
            ray_weights: vec![0.0; rays],
        }
    }

    fn check(rays: usize, per_ray: usize, active: impl Fn(usize) -> bool + Copy) {
        let batch = batch(rays, per_ray, active);
        let plan = Plan::new(&batch);
        let mut seen = Vec::new();
        let mut next = 0;
        for b in &plan.blocks {
            assert_eq!(b.start, next);
            assert!(b.len > 0 && b.cols.is_multiple_of(COLUMN_ALIGN) && b.cols - b.len < COLUMN_ALIGN);
            let samples = &plan.sample[b.start..b.start + b.len];
            assert!(samples.iter().all(|&s| b.rays.contains(&(s as usize / per_ray))));
            seen.extend_from_slice(samples);
            next += b.cols;
        }
        assert_eq!(plan.column_count(), next);
        let expected: Vec<u32> = (0..rays * per_ray).filter(|&i| active(i)).map(|i| i as u32).collect();
        assert_eq!(seen, expected);
        assert_eq!(
            plan.groups.iter().cloned().flatten().collect::<Vec<_>>(),
            (0..plan.blocks.len()).collect::<Vec<_>>()
        );
    }

    #[test]
    fn every_active_sample_lies_in_one_block() {
        check(100, 24, |_| true);
        check(100, 24, |i| i % 3 == 0);
        check(3, 700, |i| i % 7 != 0);
        check(40, 16, |i| i / 16 % 2 == 1);
        check(5, 8, |_| false);
        check(1000, 17, |i| i % 17 < i / 17 % 18);
    }
}
