//! The scene cube: the box of what several frames agree on.

use std::collections::BTreeMap;

use nalgebra::Point3;

use super::{NoiseConfig, RgbdFrame, pixel_weights};
use crate::geometry::SceneBox;

/// Cells along the longest side when looking for points that several frames agree on.
const CELLS: f64 = 100.0;
/// Share of points cut off at each end of each axis before the cells are laid.
const TRIM: f64 = 0.002;
/// Every how many pixels a point is taken.
const STRIDE: usize = 3;

/// Scene cube around the object in all states (docs/method.md 2.10): points from at least two frames (one, if
/// a state has only one) within a cell. `None` without points.
#[must_use]
pub fn scene_box(states: &[&[RgbdFrame]], noise: &NoiseConfig) -> Option<SceneBox> {
    let mut points: Vec<(usize, Point3<f64>)> = Vec::new();
    for (f, frame) in states.iter().copied().flatten().enumerate() {
        let weights = pixel_weights(frame, noise);
        let w = frame.intrinsics.width;
        for i in
            (0..weights.len()).filter(|i| (i % w).is_multiple_of(STRIDE) && (i / w).is_multiple_of(STRIDE))
        {
            if weights[i] > 0.0 && frame.is_object(i) {
                points.extend(frame.world_point(i).map(|p| (f, p)));
            }
        }
    }
    let (mut lower, mut upper) = (Point3::origin(), Point3::origin());
    for k in 0..3 {
        let mut all: Vec<f64> = points.iter().map(|(_, p)| p[k]).collect();
        if all.is_empty() {
            return None;
        }
        all.sort_unstable_by(f64::total_cmp);
        let cut = (all.len() as f64 * TRIM) as usize;
        (lower[k], upper[k]) = (all[cut], all[all.len() - 1 - cut]);
    }
    let cell_m = (upper - lower).max().max(1e-3) / CELLS;
    let mut cells: BTreeMap<[i64; 3], Agreement> = BTreeMap::new();
    for (frame, p) in &points {
        let key = [0, 1, 2].map(|k| ((p[k] - lower[k]) / cell_m).floor() as i64);
        cells.entry(key).or_insert_with(|| Agreement::new(*frame, p)).see(*frame, p);
    }
    let needed = if states.iter().all(|s| s.len() > 1) { 2 } else { 1 };
    let mut agreed = cells.values().filter(|c| c.frames >= needed);
    let first = agreed.next()?;
    let (lower, upper) =
        agreed.fold((first.lower, first.upper), |(lo, hi), c| (lo.inf(&c.lower), hi.sup(&c.upper)));
    Some(SceneBox::around(&lower, &upper))
}

/// Bounds of the points in one cell and the number of frames that have some there.
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
        // Points come frame by frame, so that the last frame is all to remember.
        self.frames += usize::from(frame != self.last);
        (self.last, self.lower, self.upper) = (frame, self.lower.inf(p), self.upper.sup(p));
    }
}
