//! Where a camera saw something else than a rendered model shows. See docs/method.md 11.4.

use super::Rendered;
use crate::{capture::RgbdFrame, geometry::Intrinsics};

/// A reading farther than this from the model's surface is none of it, standard deviations.
///
/// derived: one of 16 000 readings of a normal distribution
const SIGMAS: f64 = 4.0;

/// What the reading of a pixel says about a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Difference {
    /// Nothing: there is none, or it may be of the surroundings.
    Unread,
    /// It lies on the model's surface.
    Same,
    /// The object is where the model has nothing.
    Lacks,
    /// The model is where the camera saw through.
    Surplus,
}

/// What the readings of a frame say about a model that was rendered with the frame's camera, pixel by pixel;
/// `sigma_m` is the standard deviation of a pixel's reading against a surface that is right.
///
/// A reading is compared with all depths that the model has within one pixel: edges of object and model fall
/// on the same pixel only by chance, and a slanted surface has many depths in one.
#[must_use]
pub fn differences(frame: &RgbdFrame, model: &Rendered, sigma_m: impl Fn(usize) -> f64) -> Vec<Difference> {
    let difference = |i: usize| {
        let reading_m = f64::from(frame.depth_m[i]);
        if reading_m <= 0.0 {
            return Difference::Unread;
        }
        let around = Around::of(model, &frame.intrinsics, i);
        let error_m = SIGMAS * sigma_m(i);
        let is_behind = reading_m > around.farthest_m + error_m;
        match (frame.is_object(i), around.is_bare) {
            (true, _) if reading_m < around.nearest_m - error_m => Difference::Lacks,
            (true, false) | (false, false) if is_behind => Difference::Surplus,
            // Beside the edge of the model a reading behind it may be past the edge.
            (true, true) if is_behind => Difference::Unread,
            (true, _) => Difference::Same,
            (false, _) => Difference::Unread,
        }
    };
    (0..frame.depth_m.len()).map(difference).collect()
}

/// What a model shows at a pixel and its neighbors.
struct Around {
    /// Infinite where it shows nothing.
    nearest_m: f64,
    /// 0 where it shows nothing.
    farthest_m: f64,
    /// Whether it shows nothing at one of them.
    is_bare: bool,
}

impl Around {
    fn of(model: &Rendered, k: &Intrinsics, pixel: usize) -> Self {
        let (x, y) = (pixel % k.width, pixel / k.width);
        let mut found = Self { nearest_m: f64::INFINITY, farthest_m: 0.0, is_bare: false };
        for v in y.saturating_sub(1)..(y + 2).min(k.height) {
            for u in x.saturating_sub(1)..(x + 2).min(k.width) {
                let depth_m = f64::from(model.depth_m[v * k.width + u]);
                if depth_m > 0.0 {
                    found.nearest_m = found.nearest_m.min(depth_m);
                    found.farthest_m = found.farthest_m.max(depth_m);
                } else {
                    found.is_bare = true;
                }
            }
        }
        found
    }
}
