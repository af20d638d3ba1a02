//! How densely a surface is sampled.

use nalgebra::Point3;

use crate::observations::SurfaceSamples;

/// Motions that differ by less than this share of the reach count as equal.
/// tuned: shared/bags
pub(crate) const SETTLED: f64 = 0.02;
/// Least reach, in spacings of the samples.
/// chosen: the eight neighbors on a square of samples lie within
const LEAST_SPACINGS: f64 = 1.5;

/// The reach asked for, or more if the samples are too far apart for it, meters.
pub(crate) fn reach_m(surfaces: [&SurfaceSamples; 2], wished_m: f64) -> f64 {
    let spacing_m = surfaces.map(|s| spacing_m(&s.points, wished_m));
    wished_m.max(LEAST_SPACINGS * spacing_m[0].max(spacing_m[1]))
}

/// Mean distance between neighboring points of a surface, meters: `n` points on an area `a` are about `sqrt(a
/// / n)` apart; the area is that of the occupied cells.
pub(crate) fn spacing_m(points: &[Point3<f64>], cell_m: f64) -> f64 {
    cell_m * (occupied_cells(points, cell_m) as f64 / points.len().max(1) as f64).sqrt()
}

/// Number of cells with a point.
pub(crate) fn occupied_cells(points: &[Point3<f64>], cell_m: f64) -> usize {
    let mut cells: Vec<[i64; 3]> = points.iter().map(|p| cell_of(p, cell_m)).collect();
    cells.sort_unstable();
    cells.dedup();
    cells.len()
}

/// The cell of a point.
pub(crate) fn cell_of(point: &Point3<f64>, cell_m: f64) -> [i64; 3] {
    [0, 1, 2].map(|k| (point[k] / cell_m).floor() as i64)
}
