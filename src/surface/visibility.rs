//! Finds nodes seen by some view, and nodes that are certainly empty.

use rayon::prelude::*;

use super::{
    blocks::{BLOCK, Sight, block_ranges, sight_of_block},
    depth_tiles::DepthTiles,
    rows::RowCamera,
};
use capture::{NoiseConfig, RgbdFrame, Unread};
use geometry::Grid3;

/// When a node counts as seen through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FreeSpaceRule {
    /// Noise of the depth.
    pub noise: NoiseConfig,
    /// Standard deviation of the errors that neighboring readings share, as a multiple of the noise.
    /// Denoising leaves them as they are.
    pub shared_error: f64,
    /// What pixels off the mask show without depth.
    pub unread: Unread,
    /// A node is in front of a reading if it is nearer by this many standard deviations of the reading ...
    pub margin_sigmas: f64,
    /// ... and by at least this, meters.
    pub margin_m: f64,
    /// Least number of views that see through the node.
    pub min_views: u8,
}

impl Default for FreeSpaceRule {
    fn default() -> Self {
        Self {
            noise: NoiseConfig::default(),
            shared_error: 0.0,
            unread: Unread::Empty,
            margin_sigmas: 4.0,
            margin_m: 0.004,
            min_views: 2,
        }
    }
}

/// Whether each node of `nodes` is visible by docs/method.md (3.5): in at least one view it projects onto an
/// object pixel with known depth and is not further behind this depth than `epsilon_m`.
pub fn visibility_grid<T>(frames: &[RgbdFrame], nodes: &Grid3<T>, epsilon_m: f64) -> Grid3<bool> {
    let counts = views_in_front(frames, nodes, 1, |frame| {
        let depths = frame.depth_m.iter().enumerate();
        depths.map(|(i, &d)| if d > 0.0 && frame.is_object(i) { d + epsilon_m as f32 } else { 0.0 }).collect()
    });
    at_least(&counts, 1)
}

/// Number of views that see through each node, exact below `most`: clearly in front of a known depth, or,
/// where masks were recorded, on a ray off the mask without known depth. The nearest of the 3x3 readings
/// around a pixel counts, so smeared depth edges and masks wrong by a pixel do not carve the object. A node
/// that at least `rule.min_views` views see through is certainly empty.
pub fn views_through<T>(frames: &[RgbdFrame], nodes: &Grid3<T>, rule: &FreeSpaceRule, most: u8) -> Grid3<u8> {
    views_in_front(frames, nodes, most, |frame| free_reach(frame, rule))
}

/// Whether each node has at least this count.
pub fn at_least(counts: &Grid3<u8>, least: u8) -> Grid3<bool> {
    let Grid3 { origin, spacing_m, dims, .. } = *counts;
    Grid3 { origin, spacing_m, dims, values: counts.values.iter().map(|count| *count >= least).collect() }
}

/// Depth up to which space is certainly empty along the ray of each pixel, meters; 0 where nothing is known.
fn free_reach(frame: &RgbdFrame, rule: &FreeSpaceRule) -> Vec<f32> {
    let w = frame.intrinsics.width;
    let h = frame.intrinsics.height;
    let single: Vec<f32> = (0..w * h).map(|i| free_reach_of_pixel(frame, rule, i)).collect();
    // The least of 3 x 3 pixels: along rows, then along columns. A pixel without reach shows nothing, and
    // takes nothing from its neighbors.
    let mut across = single.clone();
    for y in 0..h {
        for x in 0..w {
            let row = &single[y * w + x.saturating_sub(1)..y * w + (x + 2).min(w)];
            let known = row.iter().filter(|reach| **reach > 0.0);
            across[y * w + x] = known.fold(f32::INFINITY, |least, reach| least.min(*reach));
        }
    }
    let mut reach = vec![0.0; w * h];
    for i in (0..w * h).filter(|i| single[*i] > 0.0) {
        let x = i % w;
        let y = i / w;
        let column = y.saturating_sub(1)..(y + 2).min(h);
        reach[i] = column.fold(f32::INFINITY, |least, y| least.min(across[y * w + x]));
    }
    reach
}

/// The same from the reading of one pixel alone.
fn free_reach_of_pixel(frame: &RgbdFrame, rule: &FreeSpaceRule, pixel: usize) -> f32 {
    let d = f64::from(frame.depth_m[pixel]);
    if d > 0.0 {
        // docs/method.md (3.6).
        let sigma_m = frame.sigma_m(pixel, &rule.noise).hypot(rule.shared_error * rule.noise.sigma_m(d));
        (d - rule.margin_m.max(rule.margin_sigmas * sigma_m)).max(0.0) as f32
    // An object without known depth may begin anywhere on the ray, so nothing on it is certainly empty.
    } else if frame.is_object(pixel) || rule.unread == Unread::Unknown {
        0.0
    } else {
        f32::INFINITY
    }
}

/// A view with the reach of its pixels.
struct ReachView {
    camera: RowCamera,
    /// Depth up to which nodes count, per pixel, meters.
    reach_m: Vec<f32>,
    tiles: DepthTiles,
}

/// For each node, how many frames see it nearer than the reach of its pixel, exact below `most`.
fn views_in_front<T>(
    frames: &[RgbdFrame],
    nodes: &Grid3<T>,
    most: u8,
    reach: impl Fn(&RgbdFrame) -> Vec<f32> + Sync,
) -> Grid3<u8> {
    let origin = nodes.origin;
    let spacing_m = nodes.spacing_m;
    let [nx, ny, nz] = nodes.dims;
    let views: Vec<ReachView> = frames
        .par_iter()
        .map(|f| {
            let k = &f.intrinsics;
            let reach_m = reach(f);
            let tiles = DepthTiles::of_image(k.width, k.height, |i| [reach_m[i]; 2]);
            let camera = RowCamera::new(k, &f.world_from_camera.inverse(), &origin, spacing_m);
            ReachView { camera, reach_m, tiles }
        })
        .collect();
    let mut votes = vec![0u8; nx * ny * nz];
    votes.par_chunks_mut((nx * ny * BLOCK).max(1)).enumerate().for_each(|(slab, votes)| {
        let layers = slab * BLOCK..((slab + 1) * BLOCK).min(nz);
        for lines in block_ranges(ny) {
            // For each block of the row, the number of views that see all of it in front.
            let mut all = vec![0u8; nx.div_ceil(BLOCK)];
            for ReachView { camera, reach_m, tiles } in &views {
                let mut mixed = Vec::new();
                for (all, range) in all.iter_mut().zip(block_ranges(nx)).filter(|(all, _)| **all < most) {
                    match sight_of_block(tiles, camera, &[range.clone(), lines.clone(), layers.clone()]) {
                        Sight::Nothing => {}
                        // A node with enough votes is skipped, so a byte cannot overflow.
                        Sight::InFront => *all += 1,
                        Sight::Mixed => mixed.push((range, most - *all)),
                    }
                }
                for (z, y) in layers.clone().flat_map(|z| lines.clone().map(move |y| (z, y))) {
                    if mixed.is_empty() {
                        break;
                    }
                    let row = camera.row_in_image(y, z, nx);
                    let votes = &mut votes[((z - layers.start) * ny + y) * nx..][..nx];
                    for (range, needed) in &mixed {
                        for x in range.start.max(row.range.start)..range.end.min(row.range.end) {
                            if votes[x] < *needed {
                                let p = row.at(x);
                                votes[x] += u8::from(p.z < reach_m[camera.pixel_of(&p)]);
                            }
                        }
                    }
                }
            }
            for (z, y) in layers.clone().flat_map(|z| lines.clone().map(move |y| (z, y))) {
                let votes = &mut votes[((z - layers.start) * ny + y) * nx..][..nx];
                for (votes, all) in votes.chunks_mut(BLOCK).zip(&all) {
                    votes.iter_mut().for_each(|v| *v = v.saturating_add(*all));
                }
            }
        }
    });
    Grid3 { origin, spacing_m, dims: nodes.dims, values: votes }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::{grid_of, orbit, sphere};

    fn free_space_grid<T>(frames: &[RgbdFrame], nodes: &Grid3<T>, rule: &FreeSpaceRule) -> Grid3<bool> {
        at_least(&views_through(frames, nodes, rule, rule.min_views), rule.min_views)
    }

    #[test]
    fn nodes_in_front_and_just_behind_are_visible_and_deep_ones_are_not() {
        let frames = orbit(&sphere(0.2), 8, 0.8);
        let nodes = grid_of(0.3, 31, sphere(0.2));
        let seen = visibility_grid(&frames, &nodes, 0.03);
        let free = free_space_grid(&frames, &nodes, &FreeSpaceRule::default());
        for i in 0..nodes.values.len() {
            let d = nodes.values[i];
            assert!(!(d < -0.04 && seen.values[i]), "deep node {d} is visible");
            assert!(!(d < 0.002 && free.values[i]), "node {d} is free");
            // Few views reach the corners of the grid.
            if d > 0.012 && d < 0.1 {
                assert!(free.values[i], "node at {d} is not free: {:?}", nodes.position_of_index(i));
            }
            if d.abs() < 0.005 {
                assert!(seen.values[i], "surface node is not visible");
            }
        }
    }

    #[test]
    fn visibility_needs_the_object_and_a_depth() {
        let mut frames = orbit(&sphere(0.2), 2, 0.8);
        let nodes = grid_of(0.3, 21, sphere(0.2));
        // Off the silhouette nothing is visible: those rays meet no object.
        let seen = visibility_grid(&frames, &nodes, 0.03);
        assert!(!seen.values[seen.index(0, 0, 20)]);
        for f in &mut frames {
            f.depth_m.fill(0.0);
        }
        assert!(visibility_grid(&frames, &nodes, 0.03).values.iter().all(|v| !v));
    }

    #[test]
    fn one_wrong_view_carves_nothing() {
        let mut frames = orbit(&sphere(0.2), 6, 0.8);
        frames[0].depth_m.fill(5.0);
        let nodes = grid_of(0.3, 31, sphere(0.2));
        let inside_free = |min_views| {
            let rule = FreeSpaceRule { min_views, ..FreeSpaceRule::default() };
            let free = free_space_grid(&frames, &nodes, &rule);
            (0..free.values.len()).filter(|&i| nodes.values[i] < 0.0 && free.values[i]).count()
        };
        assert!(inside_free(1) > 1000);
        assert_eq!(inside_free(2), 0);
    }

    #[test]
    fn errors_that_neighbors_share_keep_space_before_a_surface_open() {
        let frame = &orbit(&sphere(0.2), 1, 0.8)[0];
        let pixel = frame.depth_m.iter().position(|d| *d > 0.0).unwrap();
        let reach_m = |shared_error| {
            let rule = FreeSpaceRule { shared_error, ..FreeSpaceRule::default() };
            free_reach_of_pixel(frame, &rule, pixel)
        };
        assert!(reach_m(5.0) + 0.02 < reach_m(0.0) && reach_m(0.0) < frame.depth_m[pixel]);
    }

    #[test]
    fn without_recorded_masks_pixels_without_depth_show_nothing() {
        let mut frames = orbit(&sphere(0.2), 6, 0.8);
        for frame in &mut frames {
            frame.mask = Some(vec![false; frame.depth_m.len()]);
            frame.depth_m.fill(0.0);
        }
        let nodes = grid_of(0.3, 21, sphere(0.2));
        let count = |unread| {
            let rule = FreeSpaceRule { unread, ..FreeSpaceRule::default() };
            free_space_grid(&frames, &nodes, &rule).values.iter().filter(|free| **free).count()
        };
        assert!(count(Unread::Empty) > 1000);
        assert_eq!(count(Unread::Unknown), 0);
    }

    #[test]
    fn counts_are_exact_below_the_most_that_are_counted() {
        let frames = orbit(&sphere(0.2), 8, 0.8);
        let nodes = grid_of(0.3, 31, sphere(0.2));
        let rule = FreeSpaceRule::default();
        let many = views_through(&frames, &nodes, &rule, 5);
        for least in [1, 2, 5] {
            let alone = at_least(&views_through(&frames, &nodes, &rule, least), least);
            assert_eq!(at_least(&many, least).values, alone.values, "{least}");
        }
    }
}
