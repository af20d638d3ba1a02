//! Brightness of a color.

/// Luma in `[0, 1]` (ITU-R BT.601).
pub fn luma([r, g, b]: [u8; 3]) -> f32 {
    (0.299 * f32::from(r) + 0.587 * f32::from(g) + 0.114 * f32::from(b)) / 255.0
}
