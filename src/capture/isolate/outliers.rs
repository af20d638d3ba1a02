//! Outliers among the depth readings under a mask, such as flying pixels far from the object.

use std::num::NonZeroUsize;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use super::voxels::{Cell, CellSet, center_of_cell};
use common::stop::{Stop, Stopped};

/// Number of nearest neighbors for the mean distance.
const NEIGHBORS: NonZeroUsize = NonZeroUsize::MIN.saturating_add(15);
/// A cell is an outlier if its mean distance exceeds the average by this many standard deviations.
/// chosen: 0.1 % of a normal distribution lie beyond, one-sided
const SIGMAS: f64 = 3.0;
/// Mean distance that is never an outlier, cells: the 16 neighbors of a rod one cell wide are 4.5 cells away
/// on average. chosen: a third more than that
const ALWAYS_KEPT_CELLS: f64 = 6.0;

/// Outliers among sorted cells (statistical outlier removal, with a lower bound for rods and wires).
pub fn outlier_cells(cells: &[Cell], size_m: f64, stop: &Stop) -> Result<CellSet, Stopped> {
    if cells.len() <= NEIGHBORS.get() {
        return Ok(CellSet::default());
    }
    // By cells, not readings, so that often seen places do not make the others outliers.
    let points: Vec<[f64; 3]> = cells.iter().map(|c| center_of_cell(c, size_m).coords.into()).collect();
    let Ok(tree) = ImmutableKdTree::new_from_slice(&points) else { return Ok(CellSet::default()) };
    let mean_distances = points.par_iter().with_min_len(256).map(|p| {
        stop.check()?;
        // The nearest neighbor is the cell itself, at distance 0.
        let near = tree.query(p).nearest_n::<SquaredEuclidean<f64>>(NEIGHBORS.saturating_add(1)).execute();
        Ok(near.iter().map(|n| n.distance.sqrt()).sum::<f64>() / NEIGHBORS.get() as f64)
    });
    let distances: Vec<f64> = mean_distances.collect::<Result<_, Stopped>>()?;
    let mean = distances.iter().sum::<f64>() / distances.len() as f64;
    let deviation =
        (distances.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / distances.len() as f64).sqrt();
    let limit = (mean + SIGMAS * deviation).max(ALWAYS_KEPT_CELLS * size_m);
    Ok(cells.iter().zip(distances).filter(|(_, d)| *d > limit).map(|(c, _)| *c).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lone_cells_go_and_a_thin_rod_stays() {
        let mut cells: Vec<Cell> = (0..30).flat_map(|x| (0..30).map(move |y| [x, y, 0])).collect();
        let rod: Vec<Cell> = (1..40).map(|z| [15, 15, z]).collect();
        let lone = [[60, 0, 0], [0, 70, 5], [0, 0, -80]];
        cells.extend(&rod);
        cells.extend(lone);
        cells.sort_unstable();
        assert_eq!(outlier_cells(&cells, 0.005, &Stop::never()).unwrap(), lone.into_iter().collect());
    }

    #[test]
    fn few_cells_are_left_alone() {
        assert!(outlier_cells(&[[0, 0, 0], [90, 0, 0]], 0.01, &Stop::never()).unwrap().is_empty());
    }
}
