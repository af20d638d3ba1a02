//! Matching costs summed along eight paths of the image (semi-global matching, Hirschmueller 2008, the costs
//! of equation 13), as the D4 chips of depth cameras do (Keselman et al. 2017).

use numeric::vectorized;
use rayon::prelude::*;

use super::census::COMPARISONS;

/// Penalty of a disparity that changes by one from a pixel to the next. chosen: a sixth of the larger one
const P1: u8 = 20;
/// Penalty of a larger change. chosen: as libSGM has it for this census; with the largest cost, a path stays
/// below 256
const P2: u8 = 120;
/// Columns of a row that one thread works on.
const COLUMNS: usize = 96;
/// Paths that go down, or up: left, straight, right.
const STEPS: [isize; 3] = [-1, 0, 1];

/// Summed costs of every pixel and disparity, `[row][column][disparity]`.
pub(super) struct CostVolume {
    /// The sums.
    pub sums: Vec<u16>,
    /// Number of disparities, from 0 on.
    pub disparities: usize,
}

/// The sums for two census images; `disparities` is a multiple of 32.
pub(super) fn summed_costs(left: &[u64], right: &[u64], width: usize, disparities: usize) -> CostVolume {
    let row = width * disparities;
    let mut costs = vec![0u8; left.len() * disparities];
    let mut sums = vec![0u16; left.len() * disparities];
    costs.par_chunks_mut(row).zip(sums.par_chunks_mut(row)).enumerate().for_each(|(y, (costs, sums))| {
        let [left, right] = [left, right].map(|image| &image[y * width..][..width]);
        // Reversed, so that disparities are read in order.
        let right: Vec<u64> = right.iter().rev().copied().collect();
        hamming_costs(left, &right, disparities, costs);
        sum_along_row(costs, disparities, sums);
    });
    add_vertical_paths(&costs, row, disparities, false, &mut sums);
    add_vertical_paths(&costs, row, disparities, true, &mut sums);
    CostVolume { sums, disparities }
}

vectorized! {
    /// Hamming distances of a row's census with the other image's, whose row is reversed.
    fn hamming_costs(left: &[u64], reversed: &[u64], disparities: usize, costs: &mut [u8]) = hamming_row
}

#[inline(always)]
fn hamming_row(left: &[u64], reversed: &[u64], disparities: usize, costs: &mut [u8]) {
    for (x, (own, costs)) in left.iter().zip(costs.chunks_exact_mut(disparities)).enumerate() {
        let others = &reversed[reversed.len() - 1 - x..];
        // Disparities beyond the border cannot match.
        costs.fill(COMPARISONS);
        for (cost, other) in costs.iter_mut().zip(others) {
            *cost = (own ^ other).count_ones() as u8;
        }
    }
}

/// One pixel of a path: its costs with the cheapest way there, and their least.
#[inline(always)]
fn path_costs(costs: &[u8], before: &[u8], least_before: u8, path: &mut [u8], sums: &mut [u16]) -> u8 {
    let n = costs.len();
    let lower = &before[..n];
    let same = &before[1..][..n];
    let higher = &before[2..][..n];
    let sums = &mut sums[..n];
    let path = &mut path[1..][..n];
    let jump = least_before.saturating_add(P2);
    for d in 0..n {
        let one = lower[d].min(higher[d]).saturating_add(P1);
        let cheapest = same[d].min(one).min(jump);
        let cost = costs[d].wrapping_add(cheapest.wrapping_sub(least_before));
        path[d] = cost;
        sums[d] = sums[d].wrapping_add(u16::from(cost));
    }
    path.iter().fold(u8::MAX, |least, c| least.min(*c))
}

/// Costs of a path that has not begun, with one entry at either end that is never cheapest.
fn path_start(disparities: usize) -> Vec<u8> {
    let mut path = vec![0; disparities + 2];
    path[0] = u8::MAX;
    path[disparities + 1] = u8::MAX;
    path
}

vectorized! {
    /// Adds the paths to the right and to the left to the sums of a row.
    fn sum_along_row(costs: &[u8], disparities: usize, sums: &mut [u16]) = row_paths
}

#[inline(always)]
fn row_paths(costs: &[u8], disparities: usize, sums: &mut [u16]) {
    let width = costs.len() / disparities;
    for backwards in [false, true] {
        let mut before = path_start(disparities);
        let mut path = before.clone();
        let mut least = 0;
        for step in 0..width {
            let at = disparities * if backwards { width - 1 - step } else { step };
            let sums = &mut sums[at..][..disparities];
            least = path_costs(&costs[at..][..disparities], &before, least, &mut path, sums);
            std::mem::swap(&mut before, &mut path);
        }
    }
}

/// Costs of the three paths through each pixel of a row that come from the row before.
struct PathRow {
    /// `[column][path][disparity]`, with an entry at either end of each path.
    paths: Vec<u8>,
    /// Least costs, `[column][path]`.
    least: Vec<u8>,
}

impl PathRow {
    fn start(width: usize, disparities: usize) -> Self {
        Self {
            paths: path_start(disparities).repeat(STEPS.len() * width),
            least: vec![0; STEPS.len() * width],
        }
    }
}

/// Adds the paths that go down, or up, to the sums. Threads share a row's columns, as each row needs the one
/// before.
fn add_vertical_paths(costs: &[u8], row: usize, disparities: usize, upwards: bool, sums: &mut [u16]) {
    let width = row / disparities;
    let height = costs.len() / row;
    let mut before = PathRow::start(width, disparities);
    let mut now = PathRow::start(width, disparities);
    for step in 0..height {
        let y = if upwards { height - 1 - step } else { step };
        let costs = &costs[y * row..][..row];
        let sums = &mut sums[y * row..][..row];
        let paths = now.paths.par_chunks_mut(COLUMNS * STEPS.len() * (disparities + 2));
        let least = now.least.par_chunks_mut(COLUMNS * STEPS.len());
        let sums = sums.par_chunks_mut(COLUMNS * disparities);
        paths.zip(least).zip(sums).enumerate().for_each(|(chunk, ((paths, least), sums))| {
            add_paths_of_columns(costs, &before, chunk * COLUMNS, disparities, paths, least, sums);
        });
        std::mem::swap(&mut before, &mut now);
    }
}

vectorized! {
    /// Adds the three paths from the row before to the sums of the columns from `first` on.
    fn add_paths_of_columns(
        costs: &[u8],
        before: &PathRow,
        first: usize,
        disparities: usize,
        paths: &mut [u8],
        least: &mut [u8],
        sums: &mut [u16],
    ) = column_paths
}

#[inline(always)]
fn column_paths(
    costs: &[u8],
    before: &PathRow,
    first: usize,
    disparities: usize,
    paths: &mut [u8],
    least: &mut [u8],
    sums: &mut [u16],
) {
    let width = costs.len() / disparities;
    let size = disparities + 2;
    for (k, sums) in sums.chunks_exact_mut(disparities).enumerate() {
        let costs = &costs[(first + k) * disparities..][..disparities];
        for (p, step) in STEPS.iter().enumerate() {
            let from = (first + k) as isize + step;
            let out = &mut paths[(k * STEPS.len() + p) * size..][..size];
            if from < 0 || from >= width as isize {
                // A path begins at the border.
                out[1..=disparities].copy_from_slice(costs);
                sums.iter_mut().zip(costs).for_each(|(sum, cost)| *sum += u16::from(*cost));
                least[k * STEPS.len() + p] = costs.iter().fold(u8::MAX, |least, c| least.min(*c));
                continue;
            }
            let other = from as usize * STEPS.len() + p;
            let path = &before.paths[other * size..][..size];
            least[k * STEPS.len() + p] = path_costs(costs, path, before.least[other], out, sums);
        }
    }
}
