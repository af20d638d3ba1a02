//! Brightness of an image, interpolated between pixels.

use crate::{RgbdFrame, luma};

/// Brightness of an image, in `[0, 1]`.
pub(super) struct Gray {
    pub width: usize,
    pub height: usize,
    values: Vec<f32>,
}

impl Gray {
    pub fn of_frame(frame: &RgbdFrame) -> Self {
        let k = &frame.intrinsics;
        Self { width: k.width, height: k.height, values: frame.rgb.iter().map(|c| luma(*c)).collect() }
    }

    /// As 8-bit values, row-major.
    pub fn bytes(&self) -> Vec<u8> {
        self.values.iter().map(|v| (255.0 * v).round() as u8).collect()
    }

    /// Brightness at a position, interpolated linearly; `None` outside the pixel centers.
    pub fn value_at(&self, u: f64, v: f64) -> Option<f64> {
        let x = u.floor();
        let y = v.floor();
        let inside = x >= 0.0 && y >= 0.0 && x + 1.0 < self.width as f64 && y + 1.0 < self.height as f64;
        if !inside {
            return None;
        }
        let right = u - x;
        let down = v - y;
        let at = y as usize * self.width + x as usize;
        let value = |i: usize| f64::from(self.values[i]);
        let row = |i: usize| value(i) + right * (value(i + 1) - value(i));
        Some(row(at) + down * (row(at + self.width) - row(at)))
    }
}
