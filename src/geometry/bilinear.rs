//! Bilinear interpolation in images.

use std::ops::{Add, Mul};

/// The value of a row-major image at a place, pixels; beyond the border, that of the nearest border place.
/// `at` gives the value of a pixel by its index.
pub fn bilinear<V>(at: impl Fn(usize) -> V, width: usize, height: usize, u: f64, v: f64) -> V
where
    V: Add<Output = V> + Mul<f64, Output = V>,
{
    let u = u.clamp(0.0, (width - 1) as f64);
    let v = v.clamp(0.0, (height - 1) as f64);
    let x = u as usize;
    let y = v as usize;
    let fx = u - x as f64;
    let fy = v - y as f64;
    let right = (x + 1).min(width - 1);
    let row = |y: usize| at(y * width + x) * (1.0 - fx) + at(y * width + right) * fx;
    row(y) * (1.0 - fy) + row((y + 1).min(height - 1)) * fy
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_between_pixels_are_their_weighted_mean_and_the_border_is_repeated() {
        let image = [0.0, 100.0, 200.0, 300.0];
        let at = |u, v| bilinear(|i| image[i], 2, 2, u, v);
        assert_eq!([at(0.0, 0.0), at(0.5, 0.5), at(0.25, 1.0)], [0.0, 150.0, 225.0]);
        assert_eq!([at(-3.0, 0.5), at(7.0, 9.0)], [100.0, 300.0]);
    }
}
