//! The pieces into which a batch is cut, whatever the number of threads.

use std::ops::Range;

/// Target number of samples per block; the activations of all parts then fit in the second-level cache.
const BLOCK_SAMPLES: usize = 256;
/// Number of groups of blocks; every group sums its own gradient.
const GROUPS: usize = 32;

/// Number of rays per block.
pub(super) fn block_rays(samples: usize) -> usize {
    (BLOCK_SAMPLES / samples).max(1)
}

/// The blocks of some rays, in order.
pub(super) fn ray_blocks(rays: Range<usize>, samples: usize) -> impl Iterator<Item = Range<usize>> {
    let per_block = block_rays(samples);
    rays.clone().step_by(per_block).map(move |first| first..(first + per_block).min(rays.end))
}

/// The groups of a batch of rays, each of whole blocks.
pub(super) fn ray_groups(rays: usize, samples: usize) -> Vec<Range<usize>> {
    let per_block = block_rays(samples);
    let per_group = rays.div_ceil(per_block).div_ceil(GROUPS).max(1) * per_block;
    (0..rays).step_by(per_group).map(|first| first..(first + per_group).min(rays)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_and_their_blocks_hold_every_ray_once() {
        for (rays, samples) in [(1, 16), (100, 48), (513, 96), (7, 4096)] {
            let groups = ray_groups(rays, samples);
            assert!(groups.len() <= GROUPS);
            let seen: Vec<usize> =
                groups.iter().cloned().flat_map(|g| ray_blocks(g, samples)).flatten().collect();
            assert_eq!(seen, (0..rays).collect::<Vec<_>>());
            // Blocks of the groups are the blocks of the whole.
            let whole: Vec<_> = ray_blocks(0..rays, samples).collect();
            assert_eq!(groups.into_iter().flat_map(|g| ray_blocks(g, samples)).collect::<Vec<_>>(), whole);
        }
    }
}
