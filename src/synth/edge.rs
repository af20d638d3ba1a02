//! Depth steps between neighboring pixels.

use geometry::Intrinsics;

/// The largest depth step from a pixel to a neighbor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DepthStep {
    /// Index of that neighbor.
    pub neighbor: usize,
    /// Size of the step, meters.
    pub size_m: f64,
    /// Part of the step explained by the slope of the surface, meters.
    slope_m: f64,
}

impl DepthStep {
    /// Whether two surfaces meet here: the step exceeds that of the slope by `least_m`.
    pub(crate) fn is_beyond(&self, least_m: f64) -> bool {
        self.size_m > least_m + 2.0 * self.slope_m
    }
}

/// The step at a pixel of a depth image.
pub(super) fn depth_step(depth_m: &[f64], k: &Intrinsics, i: usize) -> DepthStep {
    let x = i % k.width;
    let y = i / k.width;
    let mut around = [i; 4];
    if x > 0 {
        around[0] = i - 1;
    }
    if x + 1 < k.width {
        around[1] = i + 1;
    }
    if y > 0 {
        around[2] = i - k.width;
    }
    if y + 1 < k.height {
        around[3] = i + k.width;
    }
    // A slope gives equal steps on both sides, an edge does not.
    let off = |n: usize| (depth_m[n] - depth_m[i]).abs();
    let slope_m = off(around[0]).min(off(around[1])).max(off(around[2]).min(off(around[3])));
    let neighbor = around.into_iter().fold(i, |best, n| if off(n) > off(best) { n } else { best });
    DepthStep { neighbor, size_m: off(neighbor), slope_m }
}
