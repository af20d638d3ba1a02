//! Logistic function.

use super::lanes::{COLUMN_ALIGN, Lanes};

/// Replaces every value by `1 / (1 + exp(-value))`, relative error below 1e-6; the length is a multiple of
/// 16.
///
/// # Panics
/// If it is not.
#[inline(always)]
pub(super) fn sigmoid<S: Lanes>(s: S, values: &mut [f32]) {
    assert!(values.len().is_multiple_of(COLUMN_ALIGN));
    for chunk in values.chunks_exact_mut(S::N) {
        // SAFETY: the chunk has N floats.
        unsafe {
            let x = s.load(chunk.as_ptr());
            let e = exp_lanes(s, s.sub(s.splat(0.0), x));
            let one = s.splat(1.0);
            s.store(chunk.as_mut_ptr(), s.div(one, s.add(one, e)));
        }
    }
}

/// `exp(x)`: `2^n exp(r)` with `|r| <= ln(2) / 2` and Taylor's polynomial of degree 7 (truncation error below
/// 2e-8).
#[inline(always)]
fn exp_lanes<S: Lanes>(s: S, x: S::F) -> S::F {
    // Beyond this range the result is 0 or 1 in single precision; exp would overflow at 88.
    let x = s.max(s.min(x, s.splat(80.0)), s.splat(-80.0));
    let t = s.mul(x, s.splat(std::f32::consts::LOG2_E));
    // Rounds half away from zero: adds a half with the sign of t before truncation.
    let half = s.sub(s.keep_above(t, s.splat(0.0), s.splat(1.0)), s.splat(0.5));
    let n = s.truncate(s.add(t, half));
    let nf = s.float(n);
    // ln(2) in two parts, so that n ln(2) is exact to working precision.
    let r = s.fma(nf, s.splat(-0.693_359_4), x);
    let r = s.fma(nf, s.splat(2.121_944_4e-4), r);
    let mut p = s.splat(1.0 / 5040.0);
    for c in [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0] {
        p = s.fma(p, r, s.splat(c));
    }
    s.mul(p, s.exp2_int(n))
}
