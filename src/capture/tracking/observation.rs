//! A frame as the tracker keeps it: small flat patches and image features, without the pixels.

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
    /// Patches of its surface, with its features as landmarks.
    pub(super) surfels: Surfels,
    landmarks: FrameLandmarks,
    /// Mean of its color, of 255.
    brightness: f64,
    /// Share of its pixels with depth.
    read: f64,
}

/// Fewest features of an image for matches.
/// derived: twice the needed followers of a motion
const FEW_FEATURES: usize = 24;
/// Least mean of an image, of 255: a darker one shows little but the noise of its camera.
/// chosen: sRGB of a third of a percent of the light of a white sheet
const DARK: f64 = 12.0;
/// Of the pixels of a frame so many must have depth.
/// measured: shared/bags and shared/bags/handheld: the least of a view is 0.3
const LEAST_READ: f64 = 0.05;

impl Observation {
    /// Of a frame without a mask, with possible gaps of single pixels in its depth (as of depth aligned to
    /// color): the surroundings of the object show the camera's motion, too.
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

    /// Why a frame cannot be placed whatever others show, if so: it shows nothing itself.
    pub(super) fn reason_unplaceable(&self) -> Option<Lost> {
        match () {
            () if self.landmarks.count() >= FEW_FEATURES && self.read >= LEAST_READ => None,
            () if self.brightness < DARK && self.read < LEAST_READ => Some(Lost::Covered),
            () if self.brightness < DARK => Some(Lost::Dark),
            () if self.read < LEAST_READ => Some(Lost::Unread),
            () => Some(Lost::Blank),
        }
    }

    /// Similar landmarks of this frame and of another, by their numbers.
    pub(super) fn matches_with(&self, other: &Self) -> Vec<[u32; 2]> {
        self.landmarks.matches_with(&other.landmarks)
    }
}

/// Least neighbors with depth of a pixel without, of eight.
/// derived: every second column and row leaves two
const LEAST_NEIGHBORS: usize = 2;
/// Largest difference of neighbors without an edge, a share of their depth.
/// chosen: a surface at 80 deg, seen over two pixels of 600 to the focal length
const EDGE_SHARE: f32 = 0.02;

/// Gives pixels without depth the mean of their neighbors', where these show one surface.
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
