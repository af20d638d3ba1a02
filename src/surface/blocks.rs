//! Blocks of grid nodes before a camera: most lie wholly in front of a view's readings, or wholly behind, and
//! are decided without a look at their nodes.

use std::ops::Range;

use nalgebra::Vector3;

use super::{depth_tiles::DepthTiles, rows::RowCamera};

/// Nodes along a side of a block.
/// tuned: shared/bags/laptop, preset default; other sizes were not tried
pub(super) const BLOCK: usize = 8;
/// A block over more tiles is examined node by node, which takes no longer.
const MOST_TILES: usize = 36;
/// Rounding of a node's depth in single precision, as a share of it and of the other depth.
/// derived: eight roundings of 2^-24
const ROUNDING: f32 = 5e-7;

/// Where a block of nodes lies relative to a view's readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Sight {
    /// Outside the image, or behind every reading: the view has no evidence of it.
    Nothing,
    /// Inside the image and in front of every reading.
    InFront,
    /// Some nodes need a closer look.
    Mixed,
}

/// Where the nodes of `ranges` (x, y, z) lie relative to an image with a depth for each of its rays. No node
/// is in front of depth 0.
pub(super) fn sight_of_block(tiles: &DepthTiles, camera: &RowCamera, ranges: &[Range<usize>; 3]) -> Sight {
    let corners: [Vector3<f32>; 8] = std::array::from_fn(|c| {
        camera.node_in_camera(
            [0, 1, 2].map(|k| if c >> k & 1 == 0 { ranges[k].start } else { ranges[k].end - 1 }),
        )
    });
    let near = corners.iter().map(|p| p.z).fold(f32::INFINITY, f32::min);
    let far = corners.iter().map(|p| p.z).fold(f32::NEG_INFINITY, f32::max);
    if !camera.is_before(near) {
        return if camera.is_before(far) { Sight::Mixed } else { Sight::Nothing };
    }
    // The projection of a box before the camera lies within the bounds of its projected corners.
    let mut low = [f32::INFINITY; 2];
    let mut high = [f32::NEG_INFINITY; 2];
    for pixel in corners.iter().map(|p| camera.project(p)) {
        for k in 0..2 {
            (low[k], high[k]) = (low[k].min(pixel[k]), high[k].max(pixel[k]));
        }
    }
    // One pixel more on each side, as positions are rounded.
    let size = tiles.image_size().map(|n| n as f32);
    if (0..2).any(|k| high[k] < -1.0 || low[k] > size[k] + 1.0) {
        return Sight::Nothing;
    }
    let whole = (0..2).all(|k| low[k] >= 1.0 && high[k] <= size[k] - 1.0);
    let covered =
        [0, 1].map(|k| [low[k] - 1.0, high[k] + 1.0].map(|at| at.clamp(0.0, size[k] - 1.0) as usize));
    if DepthTiles::tile_count(covered) > MOST_TILES {
        return Sight::Mixed;
    }
    let [nearest_m, farthest_m] = tiles.depths_over(covered);
    if near >= farthest_m + ROUNDING * (near + farthest_m) {
        return Sight::Nothing;
    }
    match whole && far <= nearest_m - ROUNDING * (far + nearest_m.min(far)) {
        true => Sight::InFront,
        false => Sight::Mixed,
    }
}

/// `0..count` cut into blocks.
pub(super) fn block_ranges(count: usize) -> impl Iterator<Item = Range<usize>> + Clone {
    (0..count).step_by(BLOCK).map(move |start| start..(start + BLOCK).min(count))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::{looking_at_origin, sphere, view_of};
    use geometry::Intrinsics;
    use nalgebra::Point3;

    /// Every block is what its nodes are, one by one.
    #[test]
    fn a_block_is_decided_as_its_nodes_are() {
        let k = Intrinsics { width: 150, height: 110, fx: 140.0, fy: 150.0, cx: 70.3, cy: 52.1 };
        let mut front = 0;
        let mut nothing = 0;
        let mut mixed = 0;
        for eye in [[0.6, 0.3, 0.4], [0.1, -0.5, 0.2], [0.05, 0.02, 0.24]] {
            let frame = view_of(&sphere(0.2), k, looking_at_origin(Point3::from(eye)));
            // What lies behind the sphere is far away on one half, and unknown on the other.
            let depth = |i: usize| match frame.depth_m[i] {
                d if d > 0.0 => d - 0.03,
                _ if i % k.width > 70 => f32::INFINITY,
                _ => 0.0,
            };
            let n = 64;
            let spacing_m = 0.01;
            let origin = Point3::new(-0.32, -0.3, -0.34);
            let camera = RowCamera::new(&k, &frame.world_from_camera.inverse(), &origin, spacing_m);
            let tiles = DepthTiles::of_image(k.width, k.height, |i| [depth(i); 2]);
            for (z, y, x) in block_ranges(n).flat_map(|z| {
                block_ranges(n).flat_map(move |y| {
                    let z = z.clone();
                    block_ranges(n).map(move |x| (z.clone(), y.clone(), x))
                })
            }) {
                let sight = sight_of_block(&tiles, &camera, &[x.clone(), y.clone(), z.clone()]);
                let mut all_in_front = true;
                let mut none_says = true;
                for (z, y) in z.flat_map(|z| y.clone().map(move |y| (z, y))) {
                    let row = camera.row_in_image(y, z, n);
                    for x in x.clone() {
                        let p = row.at(x);
                        let read = row.range.contains(&x).then(|| depth(camera.pixel_of(&p)));
                        all_in_front &= read.is_some_and(|d| p.z < d);
                        none_says &= read.is_none_or(|d| p.z >= d);
                    }
                }
                match sight {
                    Sight::InFront => {
                        front += 1;
                        assert!(all_in_front);
                    }
                    Sight::Nothing => {
                        nothing += 1;
                        assert!(none_says);
                    }
                    Sight::Mixed => mixed += 1,
                }
            }
        }
        // Most are decided at once.
        assert!(front > 40 && nothing > 300 && mixed < front + nothing, "{front} {nothing} {mixed}");
    }
}
