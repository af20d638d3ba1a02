//! Which nodes some view sees, and which are certainly empty.

use rayon::prelude::*;

use super::{
    blocks::{BLOCK, Sight, blocks, sight},
    depth_tiles::DepthTiles,
    rows::RowCamera,
};
use capture::{NoiseConfig, RgbdFrame};
use geometry::Grid3;

/// When a node counts as seen through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FreeSpaceRule {
    /// Depth noise.
    pub noise: NoiseConfig,
    /// A node is in front of a reading if it is nearer by this many standard deviations of the reading ...
    pub margin_sigmas: f64,
    /// ... and by at least this, meters.
    pub margin_m: f64,
    /// Views that must see through the node.
    pub min_views: u8,
}

impl Default for FreeSpaceRule {
    fn default() -> Self {
        Self { noise: NoiseConfig::default(), margin_sigmas: 4.0, margin_m: 0.004, min_views: 2 }
    }
}

/// Whether each node of `nodes` is visible by docs/method.md (3.5): in at least one view it projects onto an
/// object pixel with known depth and is not further behind that depth than `epsilon_m`.
#[must_use]
pub fn visibility_grid<T>(frames: &[RgbdFrame], nodes: &Grid3<T>, epsilon_m: f64) -> Grid3<bool> {
    let reach = |frame: &RgbdFrame| {
        let reach =
            |(i, &d): (usize, &f32)| if d > 0.0 && frame.is_object(i) { d + epsilon_m as f32 } else { 0.0 };
        frame.depth_m.iter().enumerate().map(reach).collect()
    };
    views_in_front(frames, nodes, 1, reach)
}

/// Whether each node of `nodes` is certainly empty: at least `rule.min_views` views see it clearly in front
/// of a known depth, or on a ray without known depth that misses the object (off the mask). The nearest of
/// the 3x3 readings around a pixel counts, so that depth bleeding and masks that are a pixel off carve
/// nothing.
#[must_use]
pub fn free_space_grid<T>(frames: &[RgbdFrame], nodes: &Grid3<T>, rule: &FreeSpaceRule) -> Grid3<bool> {
    views_in_front(frames, nodes, rule.min_views, |frame| free_reach(frame, rule))
}

/// For each pixel the z-depth up to which its ray is certainly empty; 0 where nothing is known.
fn free_reach(frame: &RgbdFrame, rule: &FreeSpaceRule) -> Vec<f32> {
    let w = frame.intrinsics.width;
    let h = frame.intrinsics.height;
    let reach = |i: usize| {
        let d = f64::from(frame.depth_m[i]);
        if d > 0.0 {
            // docs/method.md (3.6).
            (d - rule.margin_m.max(rule.margin_sigmas * frame.sigma_m(i, &rule.noise))).max(0.0) as f32
        // An object without depth may begin anywhere on the ray: nothing on it is certainly empty.
        } else if frame.is_object(i) {
            0.0
        } else {
            f32::INFINITY
        }
    };
    let single: Vec<f32> = (0..w * h).map(reach).collect();
    // A pixel without reach says nothing, but does not silence its neighbors.
    let nearest = |a: f32, b: f32| if b > 0.0 { a.min(b) } else { a };
    // The least of 3 x 3 pixels: along rows, then along columns.
    let mut across = single.clone();
    for y in 0..h {
        for x in 0..w {
            let row = &single[y * w..(y + 1) * w];
            across[y * w + x] =
                (x.saturating_sub(1)..(x + 2).min(w)).fold(f32::INFINITY, |a, x| nearest(a, row[x]));
        }
    }
    let around = |i: usize| {
        let x = i % w;
        let y = i / w;
        let least =
            (y.saturating_sub(1)..(y + 2).min(h)).fold(f32::INFINITY, |a, y| a.min(across[y * w + x]));
        if single[i] > 0.0 { least } else { 0.0 }
    };
    (0..w * h).map(around).collect()
}

/// Nodes that at least `min_views` frames see nearer than the reach of the pixel they fall on.
fn views_in_front<T>(
    frames: &[RgbdFrame],
    nodes: &Grid3<T>,
    min_views: u8,
    reach: impl Fn(&RgbdFrame) -> Vec<f32> + Sync,
) -> Grid3<bool> {
    let origin = nodes.origin;
    let spacing_m = nodes.spacing_m;
    let [nx, ny, nz] = nodes.dims;
    let views: Vec<(RowCamera, Vec<f32>, DepthTiles)> = frames
        .par_iter()
        .map(|f| {
            let k = &f.intrinsics;
            let reach = reach(f);
            let tiles = DepthTiles::of(k.width, k.height, |i| [reach[i]; 2]);
            (RowCamera::new(k, &f.world_from_camera.inverse(), &origin, spacing_m), reach, tiles)
        })
        .collect();
    let mut votes = vec![0u8; nx * ny * nz];
    votes.par_chunks_mut((nx * ny * BLOCK).max(1)).enumerate().for_each(|(slab, votes)| {
        let layers = slab * BLOCK..((slab + 1) * BLOCK).min(nz);
        for lines in blocks(ny) {
            // Of each block of the row: views that see all of it.
            let mut all = vec![0u8; nx.div_ceil(BLOCK)];
            for (camera, reach, tiles) in &views {
                let mut mixed = Vec::new();
                for (all, range) in all.iter_mut().zip(blocks(nx)).filter(|(all, _)| **all < min_views) {
                    match sight(tiles, camera, &[range.clone(), lines.clone(), layers.clone()]) {
                        Sight::Nothing => {}
                        // Nothing is asked about a node that has its votes, and a byte cannot run over.
                        Sight::InFront => *all += 1,
                        Sight::Mixed => mixed.push((range, min_views - *all)),
                    }
                }
                for (z, y) in layers.clone().flat_map(|z| lines.clone().map(move |y| (z, y))) {
                    if mixed.is_empty() {
                        break;
                    }
                    let row = camera.row(y, z, nx);
                    let votes = &mut votes[((z - layers.start) * ny + y) * nx..][..nx];
                    for (range, needed) in &mixed {
                        for x in range.start.max(row.range.start)..range.end.min(row.range.end) {
                            if votes[x] < *needed {
                                let p = row.at(x);
                                votes[x] += u8::from(p.z < reach[camera.pixel(&p)]);
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
    let values = votes.into_iter().map(|v| v >= min_views).collect();
    Grid3 { origin, spacing_m, dims: nodes.dims, values }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::{grid_of, orbit, sphere};

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
                assert!(free.values[i], "node at {d} is not free: {:?}", nodes.position(i));
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
}
