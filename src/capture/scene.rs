//! The scene cube: the box of points seen by several frames.

use nalgebra::Point3;
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::{NoiseConfig, RgbdFrame, pixel_weights::PixelWeights};
use geometry::SceneBox;

/// Cells along the longest side for finding points seen by several frames.
/// chosen: a hundredth of the scene is finer than any object in it
const CELLS: f64 = 100.0;
/// Share of points cut off at each end of each axis before cells are laid out.
/// chosen: a few stray readings in a thousand
const TRIM: f64 = 0.002;
/// Stride of sampled pixels.
const STRIDE: usize = 3;

/// Scene cube around the object in all states (docs/method.md 2.10): it encloses the points in cells seen
/// by two frames, or by one if a state has only one. `None` without points.
#[must_use]
pub fn scene_box(states: &[&[RgbdFrame]], noise: &NoiseConfig) -> Option<SceneBox> {
    let frames: Vec<&RgbdFrame> = states.iter().copied().flatten().collect();
    let points: Vec<(usize, Point3<f64>)> = frames
        .par_iter()
        .enumerate()
        .flat_map_iter(|(f, frame)| object_points(frame, noise).into_iter().map(move |p| (f, p)))
        .collect();
    if points.is_empty() {
        return None;
    }
    let axes = (0..3).into_par_iter();
    let sides: Vec<[f64; 2]> =
        axes.map(|k| trimmed_range(points.iter().map(|(_, p)| p[k]).collect())).collect();
    let [lower, upper] = [0, 1].map(|end| Point3::from([0, 1, 2].map(|k: usize| sides[k][end])));
    let cell_m = (upper - lower).max().max(1e-3) / CELLS;
    let mut cells: FxHashMap<[i64; 3], Agreement> = FxHashMap::default();
    for (frame, p) in &points {
        let key = [0, 1, 2].map(|k| ((p[k] - lower[k]) / cell_m).floor() as i64);
        cells.entry(key).or_insert_with(|| Agreement::new(*frame, p)).see(*frame, p);
    }
    let needed = if states.iter().all(|s| s.len() > 1) { 2 } else { 1 };
    // The order does not matter for extremes.
    let mut agreed = cells.values().filter(|c| c.frames >= needed);
    let first = agreed.next()?;
    let (lower, upper) =
        agreed.fold((first.lower, first.upper), |(lo, hi), c| (lo.inf(&c.lower), hi.sup(&c.upper)));
    Some(SceneBox::around_box(&lower, &upper))
}

/// Sampled world points of a frame on the object.
fn object_points(frame: &RgbdFrame, noise: &NoiseConfig) -> Vec<Point3<f64>> {
    let weights = PixelWeights::of_frame(frame, noise);
    let w = frame.intrinsics.width;
    let h = frame.intrinsics.height;
    let some = (0..h).step_by(STRIDE).flat_map(|y| (0..w).step_by(STRIDE).map(move |x| (x, y)));
    let wanted = some.filter(|&(x, y)| frame.is_object(y * w + x) && weights.weight_at(x, y) > 0.0);
    wanted.filter_map(|(x, y)| frame.world_point(y * w + x)).collect()
}

/// Least and greatest value after cutting [`TRIM`] off either end.
fn trimmed_range(mut values: Vec<f64>) -> [f64; 2] {
    let cut = (values.len() as f64 * TRIM) as usize;
    [cut, values.len() - 1 - cut].map(|at| *values.select_nth_unstable_by(at, f64::total_cmp).1)
}

/// Bounds of the points in a cell, and the number of frames with points there.
struct Agreement {
    last: usize,
    frames: usize,
    lower: Point3<f64>,
    upper: Point3<f64>,
}

impl Agreement {
    fn new(frame: usize, p: &Point3<f64>) -> Self {
        Self { last: frame, frames: 1, lower: *p, upper: *p }
    }

    fn see(&mut self, frame: usize, p: &Point3<f64>) {
        // Points come frame by frame, so the last frame is enough to count each frame once.
        self.frames += usize::from(frame != self.last);
        (self.last, self.lower, self.upper) = (frame, self.lower.inf(p), self.upper.sup(p));
    }
}
