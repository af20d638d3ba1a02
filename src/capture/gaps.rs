//! Gaps of one pixel in depth that was brought to the pixels of a larger image.
//!
//! Where a depth image is aligned to a color image of more pixels reading by reading, whole rows and columns
//! stay empty between the readings of one surface. They are no holes: the surface is known on both sides.

use rayon::prelude::*;

use super::RgbdFrame;
use common::stop::{Stop, Stopped};

/// Least number of pixels in gaps, relative to those with depth, for depth to be closed.
/// measured: at most 0.03 in stereo depth with its drop-outs (made ones, level 1), 0.7 where a depth image
/// was enlarged (docs/method.md 2.5)
const LEAST_SHARE: f64 = 0.1;
/// Largest difference in depth across a gap on one surface, relative to the depth.
/// chosen: a surface seen at 80 deg changes by this over two pixels
const ONE_SURFACE: f32 = 0.02;

/// Gives the pixels in gaps of one pixel the depth between their neighbors, if a recording has many of them.
/// Returns their number relative to the pixels with depth, `None` if nothing was changed.
///
/// # Errors
/// [`Stopped`].
pub fn close_gaps(states: &mut [Vec<RgbdFrame>], stop: &Stop) -> Result<Option<f64>, Stopped> {
    let closed: Vec<(Vec<f32>, usize)> = states
        .par_iter()
        .flatten()
        .map(|frame| stop.check().map(|()| closed_depth(frame)))
        .collect::<Result<_, Stopped>>()?;
    let frames = || states.iter().flatten();
    let read: usize = frames().map(|f| f.depth_m.iter().filter(|d| **d > 0.0).count()).sum();
    let share = closed.iter().map(|(_, gaps)| *gaps).sum::<usize>() as f64 / read.max(1) as f64;
    if share < LEAST_SHARE {
        return Ok(None);
    }
    for (frame, (depth_m, _)) in states.iter_mut().flatten().zip(closed) {
        frame.depth_m = depth_m;
    }
    Ok(Some(share))
}

/// Depth with gaps closed, first along rows, and their number.
fn closed_depth(frame: &RgbdFrame) -> (Vec<f32>, usize) {
    let width = frame.intrinsics.width;
    let height = frame.intrinsics.height;
    let mut depth_m = frame.depth_m.clone();
    let mut count = 0;
    for step in [1, width] {
        let before = depth_m.clone();
        for y in 0..height {
            for x in 0..width {
                let is_inside = if step == 1 { x > 0 && x + 1 < width } else { y > 0 && y + 1 < height };
                let at = y * width + x;
                if !is_inside || before[at] > 0.0 {
                    continue;
                }
                if let Some(between_m) = depth_between(before[at - step], before[at + step]) {
                    depth_m[at] = between_m;
                    count += 1;
                }
            }
        }
    }
    (depth_m, count)
}

/// The depth between two readings of one surface.
fn depth_between(a_m: f32, b_m: f32) -> Option<f32> {
    let is_one_surface = a_m > 0.0 && b_m > 0.0 && (a_m - b_m).abs() < ONE_SURFACE * a_m.min(b_m);
    // The inverse depth of a plane is affine in the pixel.
    is_one_surface.then(|| 2.0 * a_m * b_m / (a_m + b_m))
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{Intrinsics, Pose};

    /// A slanted wall with an edge; `is_read` says which pixels have depth.
    fn wall(is_read: impl Fn(usize, usize) -> bool) -> RgbdFrame {
        let intrinsics = Intrinsics { width: 60, height: 40, fx: 50.0, fy: 50.0, cx: 29.5, cy: 19.5 };
        let depth = |p: usize| {
            let [x, y] = [p % 60, p / 60];
            let near_m = if x < 30 { 1.0 } else { 2.0 };
            if is_read(x, y) { near_m / (1.0 + 0.002 * x as f32) } else { 0.0 }
        };
        RgbdFrame {
            id: String::new(),
            stamp_nanos: 0,
            intrinsics,
            world_from_camera: Pose::identity(),
            rgb: Vec::new(),
            depth_m: (0..60 * 40).map(depth).collect(),
            mask: None,
            readings: Vec::new(),
        }
    }

    #[test]
    fn rows_and_columns_without_readings_are_closed_but_not_across_an_edge() {
        let whole = wall(|_, _| true);
        let mut states = vec![vec![wall(|x, y| x % 5 != 0 && y % 5 != 0)]];
        let share = close_gaps(&mut states, &Stop::never()).unwrap().unwrap();
        assert!(share > 0.4, "{share}");
        let inner = (1..39).flat_map(|y| (1..59).map(move |x| (x, y)));
        for (x, y) in inner {
            let found = states[0][0].depth_m[y * 60 + x];
            let expected = if x == 30 { 0.0 } else { whole.depth_m[y * 60 + x] };
            assert!((found - expected).abs() < 1e-5, "{x} {y}: {found} {expected}");
        }
    }

    #[test]
    fn wide_holes_and_a_few_drop_outs_stay() {
        for is_read in
            [|x: usize, y: usize| (x / 2 + y / 2) % 2 == 0, |x: usize, y: usize| (7 * x + 3 * y) % 31 != 0]
        {
            let before = wall(is_read);
            let mut states = vec![vec![before.clone()]];
            assert_eq!(close_gaps(&mut states, &Stop::never()).unwrap(), None);
            assert_eq!(states[0][0].depth_m, before.depth_m);
        }
    }
}
