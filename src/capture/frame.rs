//! One RGB-D view with its camera and pose.

use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use super::{NoiseConfig, PoseFindings};
use crate::geometry::{Intrinsics, Pose};

/// One view: colour and depth share one undistorted camera.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RgbdFrame {
    /// Name for reports and match files: `<state>_<index>`, four digits, e.g. `0_0007`.
    pub id: String,
    /// Header stamp, nanoseconds.
    pub stamp_nanos: i64,
    /// Camera of both images; `width * height` pixels each.
    pub intrinsics: Intrinsics,
    /// Pose of the optical frame in the world frame.
    pub world_from_camera: Pose,
    /// Colour, row-major.
    #[serde(with = "crate::geometry::bytes")]
    pub rgb: Vec<[u8; 3]>,
    /// z-depth in metres, row-major; 0 = unknown; never NaN.
    #[serde(with = "crate::geometry::bytes")]
    pub depth_m: Vec<f32>,
    /// Object pixels, row-major; `None` until the object was isolated.
    #[serde(with = "crate::geometry::bytes::option")]
    pub mask: Option<Vec<bool>>,
    /// How many independent readings of the sensor each pixel's depth is worth; empty = one each.
    #[serde(with = "crate::geometry::bytes")]
    pub readings: Vec<f32>,
}

impl RgbdFrame {
    /// Whether a pixel shows the object (every pixel, where there is no mask).
    #[must_use]
    pub fn is_object(&self, pixel: usize) -> bool {
        self.mask.as_ref().is_none_or(|m| m[pixel])
    }

    /// Expected standard deviation of a pixel's depth, metres.
    #[must_use]
    pub fn sigma_m(&self, pixel: usize, noise: &NoiseConfig) -> f64 {
        let readings = self.readings.get(pixel).map_or(1.0, |r| f64::from(r.max(1e-3)));
        noise.sigma_m(f64::from(self.depth_m[pixel])) / readings.sqrt()
    }

    /// World point seen at a pixel index; `None` where the depth is unknown.
    #[must_use]
    pub fn world_point(&self, pixel: usize) -> Option<Point3<f64>> {
        let d = f64::from(self.depth_m[pixel]);
        let (u, v) = ((pixel % self.intrinsics.width) as f64, (pixel / self.intrinsics.width) as f64);
        (d > 0.0).then(|| self.world_from_camera * self.intrinsics.unproject(u, v, d))
    }

    /// A world point in the optical frame.
    #[must_use]
    pub fn in_camera(&self, point_in_world: &Point3<f64>) -> Point3<f64> {
        self.world_from_camera.inverse_transform_point(point_in_world)
    }
}

/// Median of a value over every 97th pixel with depth on the object; `None` where there is none.
#[must_use]
pub fn median_over_object<'a>(frames: impl Iterator<Item = &'a RgbdFrame>, value: impl Fn(&RgbdFrame, usize) -> f64) -> Option<f64> {
    const EVERY: usize = 97;
    let mut all = Vec::new();
    for f in frames {
        all.extend((0..f.depth_m.len()).step_by(EVERY).filter(|&i| f.depth_m[i] > 0.0 && f.is_object(i)).map(|i| value(f, i)));
    }
    let middle = all.len() / 2;
    (!all.is_empty()).then(|| *all.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The recording: frames of every state, and what was found or lost on the way.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Capture {
    /// A name for the object, from the folder or file: `[A-Za-z][A-Za-z0-9_]*`.
    pub name: String,
    /// Frames per state, in time order.
    pub states: Vec<Vec<RgbdFrame>>,
    /// Pixel matches that came with the data, if any.
    pub matches: Vec<PixelMatch>,
    /// Depth noise: the model of the settings, scaled to what the recording shows unless the settings say otherwise.
    pub noise: NoiseConfig,
    /// What was found of the camera poses.
    pub poses: PoseFindings,
    /// Sentences about what was degraded: damage, drops, frames not used.
    pub warnings: Vec<String>,
    /// Sentences about what was found and chosen: topics, counts, frames.
    pub notes: Vec<String>,
}

impl Capture {
    /// A recording of so many states, without frames yet.
    #[must_use]
    pub fn of_states(count: usize) -> Self {
        Self { states: vec![Vec::new(); count], ..Self::default() }
    }

    /// Frames of every state.
    #[must_use]
    pub fn frames(&self) -> Vec<&[RgbdFrame]> {
        self.states.iter().map(Vec::as_slice).collect()
    }
}

/// Most states of one recording.
pub const MAX_STATES: usize = 16;

/// A pixel of one frame that shows the same surface point as a pixel of a frame of the other state.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PixelMatch {
    /// Index of the frame in `states[0]` and its pixel (u right, v down).
    pub frame0: usize,
    /// Pixel coordinates in frame 0.
    pub pixel0: [f32; 2],
    /// Index of the frame in `states[1]`.
    pub frame1: usize,
    /// Pixel coordinates in frame 1.
    pub pixel1: [f32; 2],
}
