//! Shift of color against depth: the pose between the imagers differs from the calibration.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use rand_core::Rng;

use geometry::bilinear;
use numeric::random;

/// Length of the shift, share of the image width (1.5 of 640 pixels); its direction is random for each
/// camera. chosen: of the order that calibrations leave
const SHIFT_SHARE: f64 = 1.5 / 640.0;

/// Color shift of a camera along u and v, pixels.
pub(super) fn drawn_shift_px(level: f64, width: usize, rng: &mut impl Rng) -> [f64; 2] {
    let (sin, cos) = random::uniform_in(rng, 0.0, TAU).sin_cos();
    [cos, sin].map(|part| level * SHIFT_SHARE * width as f64 * part)
}

/// Colors shifted by a number of pixels; the border is repeated.
pub(super) fn shifted_colors(colors: &[Vector3<f64>], width: usize, by_px: [f64; 2]) -> Vec<Vector3<f64>> {
    let height = colors.len() / width;
    let places = (0..colors.len()).map(|i| [(i % width) as f64 - by_px[0], (i / width) as f64 - by_px[1]]);
    places.map(|[u, v]| bilinear(|i| colors[i], width, height, u, v)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use numeric::random::stage_rng;

    #[test]
    fn colors_move_by_the_stated_length() {
        let [du, dv] = drawn_shift_px(1.0, 640, &mut stage_rng(7, "shift", 0));
        assert!((du.hypot(dv) - 1.5).abs() < 1e-12);
        assert_eq!(drawn_shift_px(0.5, 640, &mut stage_rng(7, "shift", 0)), [0.5 * du, 0.5 * dv]);
        // On a ramp the shift can be read off.
        let w = 20;
        let h = 10;
        let ramp: Vec<_> = (0..w * h).map(|i| Vector3::new((i % w) as f64, (i / w) as f64, 0.0)).collect();
        let moved = shifted_colors(&ramp, w, [du, dv]);
        let middle = 5 * w + 10;
        assert!((moved[middle] - (ramp[middle] - Vector3::new(du, dv, 0.0))).norm() < 1e-12);
        assert_eq!(shifted_colors(&ramp, w, [0.0, 0.0]), ramp);
    }
}
