//! Transfers part labels from surface points to the nodes of a grid.

use nalgebra::Point3;
use rayon::prelude::*;

use crate::part_surface::assemble::NO_LABEL;
use geometry::{Grid3, NearestPoints};

/// Label of the nearest surface point at every node closer than `reach_m` to the surface (by `tsdf`, meters);
/// [`NO_LABEL`] at all other nodes.
pub fn label_grid(tsdf: &Grid3<f32>, points: &[Point3<f64>], labels: &[u8], reach_m: f64) -> Grid3<u8> {
    let mut out = Grid3 {
        origin: tsdf.origin,
        spacing_m: tsdf.spacing_m,
        dims: tsdf.dims,
        values: vec![NO_LABEL; tsdf.values.len()],
    };
    let nearest = NearestPoints::new(points);
    let layer = tsdf.dims[0] * tsdf.dims[1];
    out.values.par_chunks_mut(layer).enumerate().for_each(|(z, values)| {
        for (i, value) in values.iter_mut().enumerate() {
            let node = z * layer + i;
            // NaN (nothing was observed) is not near either.
            if f64::from(tsdf.values[node].abs()) < reach_m {
                *value =
                    nearest.nearest_one(&tsdf.position_of_index(node)).map_or(NO_LABEL, |(i, _)| labels[i]);
            }
        }
    });
    out
}
