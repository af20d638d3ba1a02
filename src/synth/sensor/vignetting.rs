//! Vignetting: image corners darker than the center.

use geometry::Intrinsics;

/// Share of light lost in an image corner. The law of an ideal lens, the fourth power of the cosine of the
/// field angle, gives 0.4 at 36 degrees; drivers correct about half.
/// chosen: half of that value
const CORNER: f64 = 0.2;

/// Factor on the linear color of a pixel.
pub(super) fn vignetting_factor(level: f64, k: &Intrinsics, pixel: usize) -> f64 {
    let off = |u: f64, v: f64| (u - k.cx).hypot(v - k.cy);
    let corner = off(0.0, 0.0).max(off(k.width as f64, k.height as f64));
    let share = off((pixel % k.width) as f64, (pixel / k.width) as f64) / corner;
    1.0 - (level * CORNER).min(1.0) * share * share
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_is_bright_and_the_corner_lacks_its_share() {
        let k = Intrinsics { width: 640, height: 480, fx: 577.0, fy: 577.0, cx: 320.0, cy: 240.0 };
        assert_eq!(vignetting_factor(1.0, &k, 240 * 640 + 320), 1.0);
        assert!(
            (vignetting_factor(1.0, &k, 0) - 0.8).abs() < 1e-9
                && (vignetting_factor(0.5, &k, 0) - 0.9).abs() < 1e-9
        );
    }
}
