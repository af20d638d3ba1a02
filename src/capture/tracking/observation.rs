//! A frame as kept by the tracker: surfels and image features, without the pixels.

use super::lost::Lost;
use crate::{
    NoiseConfig, RgbdFrame,
    poses::{landmarks::FrameLandmarks, surfels::Surfels},
};
use common::ahead::Ahead;

/// Surfels and landmarks of a frame, about a megabyte.
pub struct Observation {
    /// Stamp of its color image, nanoseconds.
    pub stamp_nanos: i64,
    /// Surfels, with features as landmarks.
    pub(super) surfels: Surfels,
    landmarks: FrameLandmarks,
    /// Mean color value, 0 to 255.
    brightness: f64,
    /// Share of pixels with depth.
    read: f64,
}

/// Fewest features of a usable image.
/// derived: twice the number that must follow a motion
const FEW_FEATURES: usize = 24;
/// Least mean value of a usable image, of 255: a darker one shows little but noise.
/// chosen: in sRGB a third of a percent of the light of a white sheet
const DARK: f64 = 12.0;
/// Least share of pixels with depth in a usable frame.
/// measured: shared/bags and shared/bags/handheld: 0.3 at least
const LEAST_READ: f64 = 0.05;

impl Observation {
    /// The observation of a frame, regardless of its mask: the surroundings of the object show the camera
    /// motion, too. Depth may have gaps of single pixels, as after alignment to color.
    #[must_use]
    pub fn of_frame(mut frame: RgbdFrame, noise: &NoiseConfig, ahead: &Ahead) -> Self {
        fill_gaps(&mut frame);
        let frame = &frame;
        let mut surfels = Surfels::of_frame(frame, noise, |_| true);
        let landmarks = FrameLandmarks::find_in_frame(frame, &mut surfels, noise, ahead);
        let count = frame.rgb.len().max(1) as f64;
        Self {
            stamp_nanos: frame.stamp_nanos,
            surfels,
            landmarks,
            brightness: frame.rgb.iter().flatten().map(|c| f64::from(*c)).sum::<f64>() / (3.0 * count),
            read: frame.depth_m.iter().filter(|d| **d > 0.0).count() as f64 / count,
        }
    }

    /// Why the frame itself cannot be located, if it is unusable.
    pub(super) fn reason_unplaceable(&self) -> Option<Lost> {
        match () {
            () if self.landmarks.count() >= FEW_FEATURES && self.read >= LEAST_READ => None,
            () if self.brightness < DARK && self.read < LEAST_READ => Some(Lost::Covered),
            () if self.brightness < DARK => Some(Lost::Dark),
            () if self.read < LEAST_READ => Some(Lost::Unread),
            () => Some(Lost::Blank),
        }
    }

    /// Index pairs of matching landmarks of two frames.
    pub(super) fn matches_with(&self, other: &Self) -> Vec<[u32; 2]> {
        self.landmarks.matches_with(&other.landmarks)
    }
}

/// Fewest of the eight neighbors with depth to fill a pixel.
/// derived: depth at every second column and row leaves two
const LEAST_NEIGHBORS: usize = 2;
/// Largest difference of these neighbors' depths, share of their depth.
/// chosen: a surface at 80 deg over two pixels at a focal length of 600 pixels
const EDGE_SHARE: f32 = 0.02;

/// Fills pixels without depth by the mean of their neighbors, where these lie on one surface.
fn fill_gaps(frame: &mut RgbdFrame) {
    let width = frame.intrinsics.width;
    let height = frame.intrinsics.height;
    let read = frame.depth_m.clone();
    for y in 1..height.saturating_sub(1) {
        for x in 1..width.saturating_sub(1) {
            let at = y * width + x;
            if read[at] > 0.0 {
                continue;
            }
            let mut sum = 0.0f32;
            let mut count = 0usize;
            let mut least = f32::INFINITY;
            let mut most = 0.0f32;
            for row in [at - width, at, at + width] {
                for &d in read[row - 1..=row + 1].iter().filter(|d| **d > 0.0) {
                    (sum, count, least, most) = (sum + d, count + 1, least.min(d), most.max(d));
                }
            }
            if count >= LEAST_NEIGHBORS && most - least <= EDGE_SHARE * most {
                frame.depth_m[at] = sum / count as f32;
            }
        }
    }
}
