//! Sine and cosine for the inner loop of rollouts: polynomials on an eighth of a turn (those of Sun's
//! fdlibm), several times as fast as the C library's functions, which change the rounding mode at every call.

use std::f64::consts::FRAC_2_PI;

/// The first 33 bits of a quarter turn, and the rest, radians.
/// derived: its binary digits.
const QUARTER: (f64, f64) = (1.570_796_326_734_125_6, 6.077_100_506_506_192e-11);
/// Adding and subtracting this rounds to the nearest integer.
/// derived: `1.5 * 2^52`.
const ROUNDING: f64 = 6_755_399_441_055_744.0;
/// Larger angles are passed to the standard library, radians.
/// chosen: less than 2^20 quarters, so the product with the first 33 bits is exact.
const MAX_ANGLE: f64 = 1e5;

/// Coefficients of `sin(r) / r^3` and of `cos(r) / r^4` after their first terms, by even powers.
/// derived: those of fdlibm.
const SINE: [f64; 6] = [
    -1.666_666_666_666_663_2e-1,
    8.333_333_333_322_49e-3,
    -1.984_126_982_985_795e-4,
    2.755_731_370_707_006_8e-6,
    -2.505_076_025_340_686_3e-8,
    1.589_690_995_211_55e-10,
];
/// derived: those of fdlibm.
const COSINE: [f64; 6] = [
    4.166_666_666_666_66e-2,
    -1.388_888_888_887_411e-3,
    2.480_158_728_947_673e-5,
    -2.755_731_435_139_066e-7,
    2.087_572_321_298_175e-9,
    -1.135_964_755_778_819_5e-11,
];

/// Sine and cosine of an angle, radians, to a few units in the last place of 1.
#[inline]
#[must_use]
pub fn sin_cos(angle: f64) -> (f64, f64) {
    // Negated, so NaN is passed to the standard library too.
    if !(angle.abs() < MAX_ANGLE) {
        return angle.sin_cos();
    }
    // The sum has no bits below one, so it is rounded; its last two bits are the quadrant.
    let shifted = angle * FRAC_2_PI + ROUNDING;
    let quarters = shifted - ROUNDING;
    // Subtracted in two parts, the first without rounding, so no digits cancel.
    let r = angle - quarters * QUARTER.0 - quarters * QUARTER.1;
    let z = r * r;
    let at = |c: &[f64; 6]| c[0] + z * (c[1] + z * (c[2] + z * (c[3] + z * (c[4] + z * c[5]))));
    let sine = r + r * z * at(&SINE);
    let cosine = 1.0 - 0.5 * z + z * z * at(&COSINE);
    match shifted.to_bits() & 3 {
        0 => (sine, cosine),
        1 => (cosine, -sine),
        2 => (-sine, -cosine),
        _ => (-cosine, sine),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_that_of_the_library() {
        for i in -400_000..400_000 {
            let angle = 2.5e-4 * f64::from(i) * (1.0 + 0.01 * f64::from(i % 17));
            let (s, c) = sin_cos(angle);
            let (ls, lc) = angle.sin_cos();
            assert!((s - ls).abs() < 5e-16 && (c - lc).abs() < 5e-16, "{angle}: {s} {ls}, {c} {lc}");
        }
        assert_eq!(sin_cos(3e7), 3e7f64.sin_cos());
        assert!(sin_cos(f64::NAN).0.is_nan());
    }
}
