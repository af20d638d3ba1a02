//! For each pixel of a view, the depth up to which space is surely empty and up to which there may be
//! surface. Tiles of pixels judge most of space many cells at a time.

use nalgebra::Vector3;

use super::view_depth::{MAX_DEPTH_M, ViewDepth};
use crate::depth_tiles::DepthTiles;
use capture::PoseNoise;

/// Least distance of an empty cell in front of a reading, in joint standard deviations of reading and pose.
/// chosen: 0.13 % of normal readings, one-sided
const GATE_SIGMAS: f64 = 3.0;

/// Space farther away than this many median depths of a view is not examined.
/// chosen: the largest ball in an image of 55 degrees ends at 1.46 distances
const FARTHEST: f64 = 1.5;

/// What a view shows of a piece of space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SpaceState {
    /// It is outside the image, or hidden.
    Nothing,
    /// All of it was seen empty.
    Empty,
    /// It must be examined in detail.
    Mixed,
}

/// Depths of seen empty and of seen filled space in a view.
pub(super) struct Clearance {
    focal: [f32; 2],
    center: [f32; 2],
    /// Depth up to which space is empty, per pixel, meters; 0 where nothing is known.
    clear_m: Vec<f32>,
    /// There is something between `clear_m` and this depth, meters.
    reach_m: Vec<f32>,
    /// Least `clear_m` and largest `reach_m` of the pixels of each tile.
    tiles: DepthTiles,
    /// Largest known depth, meters.
    farthest_m: f32,
    /// Depth up to which empty space is of interest, meters.
    pub sight_m: f32,
}

impl Clearance {
    /// The clearance of a view for cells of `cell_m`.
    pub(super) fn new(view: &ViewDepth, cell_m: f64) -> Self {
        let k = &view.frame.intrinsics;
        // Half a cell's diagonal.
        let half_m = 0.5 * 3f64.sqrt() * cell_m;
        let mut clear_m = Vec::new();
        let mut reach_m = Vec::new();
        clear_m.reserve_exact(view.readings.len());
        reach_m.reserve_exact(view.readings.len());
        let mut farthest_m = 0.0f32;
        for (r, cosine) in view.readings.iter().zip(&view.cosines) {
            let known = match r.depth_m {
                _ if r.weight() <= 0.0 => [0.0, 0.0],
                depth_m if depth_m.is_finite() => {
                    let z = f64::from(depth_m);
                    // Along a ray slanted to the surface, a cell and an error of the pose reach farther.
                    let cosine = f64::from(*cosine).max(view.noise.grazing_cosine);
                    let pose_m = PoseNoise::EXPECTED.displacement_m(z) / cosine;
                    let off_m = GATE_SIGMAS * view.noise.sigma_m(z).hypot(pose_m);
                    let gate_m = off_m.hypot(half_m / cosine) as f32;
                    [(depth_m - gate_m).max(0.0), depth_m + gate_m]
                }
                _ => [MAX_DEPTH_M, MAX_DEPTH_M],
            };
            clear_m.push(known[0]);
            reach_m.push(known[1]);
            farthest_m = farthest_m.max(known[1]);
        }
        Self {
            tiles: DepthTiles::of_image(k.width, k.height, |i| [clear_m[i], reach_m[i]]),
            focal: [k.fx as f32, k.fy as f32],
            center: [k.cx as f32, k.cy as f32],
            clear_m,
            reach_m,
            farthest_m,
            sight_m: farthest_m.min((FARTHEST * view.median_m) as f32),
        }
    }

    /// Whether a point at a depth in a pixel is where something is (`Some(true)`) or in space seen empty
    /// (`Some(false)`).
    pub(super) fn is_filled(&self, pixel: usize, depth_m: f32) -> Option<bool> {
        match () {
            () if depth_m <= self.clear_m[pixel] => Some(false),
            () if depth_m <= self.reach_m[pixel] => Some(true),
            () => None,
        }
    }

    /// State of a ball around a point in the optical frame; space up to `behind_m` behind the seen surface
    /// is still [`SpaceState::Mixed`].
    pub(super) fn state_of_ball(&self, p: &Vector3<f32>, radius_m: f32, behind_m: f32) -> SpaceState {
        if p.z + radius_m <= 0.0 || p.z - radius_m > self.farthest_m + behind_m {
            return SpaceState::Nothing;
        }
        // At this distance its image is no longer a circle.
        if p.z <= 1.5 * radius_m {
            return SpaceState::Mixed;
        }
        let mut is_cut = false;
        let mut range = [[0usize; 2]; 2];
        for (axis, size) in self.tiles.image_size().into_iter().enumerate() {
            let middle = self.focal[axis] * p[axis] / p.z + self.center[axis];
            let half = self.focal[axis] * radius_m * (1.0 + (p[axis] / p.z).abs()) / (p.z - radius_m);
            let from = middle - half;
            let to = middle + half;
            let last = size as f32 - 1.0;
            // Written so that it also holds for NaN.
            if !(to >= 0.0 && from <= last) {
                return SpaceState::Nothing;
            }
            is_cut |= from < 0.0 || to > last;
            range[axis] = [from.max(0.0) as usize, to.min(last) as usize];
        }
        let [clear_m, reach_m] = self.tiles.depths_over(range);
        match () {
            () if reach_m + behind_m < p.z - radius_m => SpaceState::Nothing,
            () if clear_m >= p.z + radius_m && !is_cut => SpaceState::Empty,
            () => SpaceState::Mixed,
        }
    }
}
