//! A match of two pixels.

use serde::{Deserialize, Serialize};

/// A pixel of one frame and a pixel of a frame of the other state with the same surface point.
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
