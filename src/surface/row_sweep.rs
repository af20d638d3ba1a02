//! Reads a row of nodes in one view, many nodes at once: the weights of nodes seen empty are added, and nodes
//! near a surface are listed for a closer look.

use super::{
    rows::{LANES, Row, RowCamera},
    tsdf_view::{FREE_WEIGHT, Reading},
};
use numeric::vectorized;

/// A view, prepared for reading rows.
#[derive(Clone, Copy)]
pub(super) struct Sweep<'a> {
    /// The grid in front of the view's camera.
    pub camera: &'a RowCamera,
    /// The reading of each pixel.
    pub readings: &'a [Reading],
    /// Truncation distance, meters.
    pub truncation_m: f32,
}

/// Sums for the nodes of a row.
pub(super) struct RowSums<'a> {
    /// Weighted distances, in truncation distances.
    pub sums: &'a mut [f32],
    /// Sums of the weights.
    pub weights: &'a mut [f32],
}

vectorized! {
    /// Adds a view's free space to a row. Appends to `near` the x of nodes within the truncation distance of
    /// a surface, ascending.
    pub(super) fn sweep_over(sweep: Sweep<'_>, row: &Row, sums: RowSums<'_>, near: &mut Vec<usize>) = over_any
}

#[inline(always)]
fn over_any(sweep: Sweep<'_>, row: &Row, sums: RowSums<'_>, near: &mut Vec<usize>) {
    let RowSums { sums, weights } = sums;
    for first in row.range.clone().step_by(LANES) {
        let count = LANES.min(row.range.end - first);
        let (free, close) = free_and_near(sweep, row, first);
        let sums = &mut sums[first..first + count];
        let weights = &mut weights[first..first + count];
        match (<&mut [f32; LANES]>::try_from(&mut *sums), <&mut [f32; LANES]>::try_from(&mut *weights)) {
            (Ok(sums), Ok(weights)) => add_free(sums, weights, &free),
            // The last nodes of the row.
            _ => add_free(sums, weights, &free[..count]),
        }
        // Few nodes are near a surface.
        if u128::from_ne_bytes(close) != 0 {
            near.extend((0..count).filter(|k| close[*k] != 0).map(|k| first + k));
        }
    }
}

#[inline(always)]
fn add_free(sums: &mut [f32], weights: &mut [f32], free: &[f32]) {
    for ((sum, weight), free) in sums.iter_mut().zip(weights).zip(free) {
        *sum += free;
        *weight += free;
    }
}

/// For each of the nodes from `first` on: the weight of empty space, and 1 if it is near a read surface.
#[inline(always)]
fn free_and_near(sweep: Sweep<'_>, row: &Row, first: usize) -> ([f32; LANES], [u8; LANES]) {
    let Sweep { camera, readings, truncation_m } = sweep;
    let (pixels, z) = camera.pixels_and_depths(row, first);
    let mut depth_m = [0.0f32; LANES];
    let mut weight = [0.0f32; LANES];
    for k in 0..LANES {
        let reading = readings[pixels[k] as usize];
        (depth_m[k], weight[k]) = (reading.depth_m, reading.signed_weight());
    }
    let mut free = [0.0; LANES];
    let mut close = [0; LANES];
    for k in 0..LANES {
        let ahead_m = depth_m[k] - z[k];
        free[k] = if ahead_m >= truncation_m { FREE_WEIGHT * weight[k].abs() } else { 0.0 };
        close[k] = u8::from((weight[k] > 0.0) & (ahead_m.abs() < truncation_m));
    }
    (free, close)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        TsdfView,
        shapes::{looking_at_origin, sphere, view_of},
        tsdf_view::{NodeReading, reading_of_node},
    };
    use capture::{NoiseConfig, Unread};
    use geometry::Intrinsics;
    use nalgebra::Point3;

    #[test]
    fn a_row_is_read_as_its_nodes_are_one_by_one() {
        let k = Intrinsics { width: 64, height: 48, fx: 60.0, fy: 58.0, cx: 30.3, cy: 25.1 };
        let truncation_m = 0.04;
        let mut free = 0;
        let mut surface = 0;
        for eye in [[0.5, 0.4, 0.3], [0.0, -0.6, 0.1], [0.15, 0.02, 0.2]] {
            let mut frame = view_of(&sphere(0.2), k, looking_at_origin(Point3::from(eye)));
            // Pixels off the object that read a depth, and that read none.
            let on = frame.depth_m.iter().enumerate().map(|(i, d)| *d > 0.0 && i % 7 != 0).collect();
            frame.mask = Some(on);
            let view = TsdfView::of_object(&frame, Unread::Empty, &NoiseConfig::default());
            let origin = Point3::new(-0.3, -0.3, -0.3);
            let camera = RowCamera::new(&k, &frame.world_from_camera.inverse(), &origin, 0.012);
            let sweep = Sweep { camera: &camera, readings: &view.readings, truncation_m };
            for (y, z) in (0..50).flat_map(|y| (0..50).map(move |z| (y, z))) {
                let row = camera.row_in_image(y, z, 50);
                let mut sums = vec![0.0; 50];
                let mut listed = Vec::new();
                for x in row.range.clone() {
                    match reading_of_node(&view.readings, &k, &camera, &row.at(x), truncation_m) {
                        Some(NodeReading::Free { weight }) => sums[x] = FREE_WEIGHT * weight,
                        Some(NodeReading::Near { .. }) => listed.push(x),
                        None => {}
                    }
                }
                free += sums.iter().filter(|s| **s > 0.0).count();
                surface += listed.len();
                for kernel in [over_any, sweep_over] {
                    let mut found = vec![0.0; 50];
                    let mut weights = vec![0.0; 50];
                    let mut near = Vec::new();
                    let row_sums = RowSums { sums: &mut found, weights: &mut weights };
                    kernel(sweep, &row, row_sums, &mut near);
                    assert_eq!((&found, &weights), (&sums, &sums));
                    // Between pixels a node may prove further behind the surface than its own pixel says.
                    assert!(listed.iter().all(|x| near.contains(x)));
                    assert!(near.is_sorted() && near.len() <= listed.len() + 3);
                }
            }
        }
        assert!(free > 1000 && surface > 1000, "{free} {surface}");
    }
}
