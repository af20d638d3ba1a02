//! A match of two pixels.

use serde::{Deserialize, Serialize};

/// A pixel of one state and a pixel of another that show the same surface point.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PixelMatch {
    /// Index of the frame in `states[0]`.
    pub frame0: usize,
    /// Pixel (u right, v down) in this frame.
    pub pixel0: [f32; 2],
    /// Index of the frame in `states[1]`.
    pub frame1: usize,
    /// Pixel (u right, v down) in this frame.
    pub pixel1: [f32; 2],
}
