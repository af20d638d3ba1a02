//! The disparity of each pixel: the least summed cost, if it is clearly least and both images agree.

use numeric::vectorized;
use rayon::prelude::*;

use super::semi_global::CostVolume;

/// How much cheaper the best disparity must be than any other but its neighbors, share.
/// chosen: as usual for this check
const UNIQUE: f32 = 0.02;
/// Largest difference of the disparities of both images, pixels.
const AGREEMENT: usize = 1;

/// Disparities of the left image, pixels, row-major; `NAN` for none.
pub(super) fn disparity_image(volume: &CostVolume, width: usize) -> Vec<f32> {
    let n = volume.disparities;
    let mut disparity = vec![f32::NAN; volume.sums.len() / n];
    let rows = volume.sums.par_chunks(width * n);
    disparity.par_chunks_mut(width).zip(rows).for_each(|(out, sums)| {
        let mut winners = vec![0; width];
        // In the order of the reversed right row.
        let mut right = vec![u32::MAX; width + n];
        row_winners(sums, n, &mut winners, &mut right);
        for (x, sums) in sums.chunks_exact(n).enumerate() {
            let best = (winners[x] & u32::from(u16::MAX)) as usize;
            let cost = (winners[x] >> 16) as u16;
            // The right image's pixel that this one matches, and its own disparity.
            let other = (right[width - 1 - x + best] & u32::from(u16::MAX)) as usize;
            if best <= x && other.abs_diff(best) <= AGREEMENT && is_unique(sums, best, cost) {
                out[x] = best as f32 + parabola_offset(sums, best);
            }
        }
    });
    disparity
}

vectorized! {
    /// The best disparity of each pixel of a row in both images, as cost times 2^16 plus disparity. `right`
    /// is reversed.
    fn row_winners(sums: &[u16], disparities: usize, winners: &mut [u32], right: &mut [u32]) = best_of_row
}

#[inline(always)]
fn best_of_row(sums: &[u16], disparities: usize, winners: &mut [u32], right: &mut [u32]) {
    let width = winners.len();
    for (x, (sums, winner)) in sums.chunks_exact(disparities).zip(winners).enumerate() {
        let right = &mut right[width - 1 - x..][..disparities];
        let mut best = u32::MAX;
        for d in 0..disparities {
            let candidate = u32::from(sums[d]) << 16 | d as u32;
            best = best.min(candidate);
            right[d] = right[d].min(candidate);
        }
        *winner = best;
    }
}

fn is_unique(sums: &[u16], best: usize, cost: u16) -> bool {
    let below = &sums[..best.saturating_sub(1)];
    let above = &sums[(best + 2).min(sums.len())..];
    let second = below.iter().chain(above).fold(u16::MAX, |least, s| least.min(*s));
    f32::from(cost) <= (1.0 - UNIQUE) * f32::from(second)
}

/// Offset of the minimum of the parabola through three costs, in `[-0.5, 0.5]`.
fn parabola_offset(sums: &[u16], best: usize) -> f32 {
    if best == 0 || best + 1 == sums.len() {
        return 0.0;
    }
    let [before, at, after] = [best - 1, best, best + 1].map(|d| f32::from(sums[d]));
    let bend = before - 2.0 * at + after;
    if bend > 0.0 { 0.5 * (before - after) / bend } else { 0.0 }
}
