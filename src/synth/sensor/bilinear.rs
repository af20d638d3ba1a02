//! Interpolation of colors between pixels.

use nalgebra::Vector3;

/// Bilinear color of a row-major image at a position `[u, v]`; the border is repeated.
pub(super) fn bilinear_color(colors: &[Vector3<f64>], width: usize, [u, v]: [f64; 2]) -> Vector3<f64> {
    let height = colors.len() / width;
    let u = u.clamp(0.0, (width - 1) as f64);
    let v = v.clamp(0.0, (height - 1) as f64);
    let x = u as usize;
    let y = v as usize;
    let right = (x + 1).min(width - 1);
    let below = (y + 1).min(height - 1);
    let s = u - x as f64;
    let t = v - y as f64;
    let row = |y: usize| colors[y * width + x] * (1.0 - s) + colors[y * width + right] * s;
    row(y) * (1.0 - t) + row(below) * t
}
