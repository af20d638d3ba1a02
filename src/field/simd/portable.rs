//! Four lanes in plain Rust; the compiler turns them into SSE2 or NEON.

use std::array::from_fn;

use super::lanes::{Lanes, lane_methods};

/// Token: no features needed.
#[derive(Clone, Copy)]
pub(super) struct Portable;

/// `a * b + c`, fused where the baseline has the instruction.
#[inline(always)]
fn fused_multiply_add(a: f32, b: f32, c: f32) -> f32 {
    // Without the instruction, a fused product would call the math library.
    if cfg!(target_arch = "aarch64") { a.mul_add(b, c) } else { a * b + c }
}

/// The expressions below need no token.
macro_rules! plain {
    ($e:expr) => {
        $e
    };
}

impl Lanes for Portable {
    type F = [f32; 4];
    type I = [i32; 4];
    const N: usize = 4;
    const TILE: usize = 2;

    #[inline(always)]
    unsafe fn load(self, at: *const f32) -> [f32; 4] {
        // SAFETY: the caller's promise; the read is unaligned.
        unsafe { at.cast::<[f32; 4]>().read_unaligned() }
    }
    #[inline(always)]
    unsafe fn store(self, at: *mut f32, value: [f32; 4]) {
        // SAFETY: the caller's promise; the write is unaligned.
        unsafe { at.cast::<[f32; 4]>().write_unaligned(value) }
    }
    #[inline(always)]
    unsafe fn store_int(self, at: *mut i32, value: [i32; 4]) {
        // SAFETY: the caller's promise; the write is unaligned.
        unsafe { at.cast::<[i32; 4]>().write_unaligned(value) }
    }
    #[inline(always)]
    unsafe fn gather_pairs(self, table: *const f32, index: [i32; 4]) -> ([f32; 4], [f32; 4]) {
        // SAFETY: the caller promises that every pair lies in the table.
        let pairs = index.map(|i| unsafe { table.add(2 * i as usize).cast::<[f32; 2]>().read_unaligned() });
        (pairs.map(|p| p[0]), pairs.map(|p| p[1]))
    }

    lane_methods! {
        plain:
        splat(value: f32) -> Self::F = [value; 4];
        add(a: Self::F, b: Self::F) -> Self::F = from_fn(|i| a[i] + b[i]);
        sub(a: Self::F, b: Self::F) -> Self::F = from_fn(|i| a[i] - b[i]);
        mul(a: Self::F, b: Self::F) -> Self::F = from_fn(|i| a[i] * b[i]);
        div(a: Self::F, b: Self::F) -> Self::F = from_fn(|i| a[i] / b[i]);
        fma(a: Self::F, b: Self::F, c: Self::F) -> Self::F =
            from_fn(|i| fused_multiply_add(a[i], b[i], c[i]));
        max(a: Self::F, b: Self::F) -> Self::F = from_fn(|i| if a[i] > b[i] { a[i] } else { b[i] });
        min(a: Self::F, b: Self::F) -> Self::F = from_fn(|i| if a[i] < b[i] { a[i] } else { b[i] });
        sqrt(a: Self::F) -> Self::F = a.map(f32::sqrt);
        keep_above(test: Self::F, bound: Self::F, value: Self::F) -> Self::F =
            from_fn(|i| if test[i] > bound[i] { value[i] } else { 0.0 });
        abs(a: Self::F) -> Self::F = a.map(f32::abs);
        sum4(v: [Self::F; 4]) -> [f32; 4] = v.map(|[a, b, c, d]| (a + b) + (c + d));
        splat_int(value: i32) -> Self::I = [value; 4];
        add_int(a: Self::I, b: Self::I) -> Self::I = from_fn(|i| a[i].wrapping_add(b[i]));
        mul_int(a: Self::I, b: Self::I) -> Self::I = from_fn(|i| a[i].wrapping_mul(b[i]));
        xor(a: Self::I, b: Self::I) -> Self::I = from_fn(|i| a[i] ^ b[i]);
        and(a: Self::I, b: Self::I) -> Self::I = from_fn(|i| a[i] & b[i]);
        clamp_int(a: Self::I, low: i32, high: i32) -> Self::I = a.map(|x| x.max(low).min(high));
        truncate(a: Self::F) -> Self::I = a.map(|x| x as i32);
        float(a: Self::I) -> Self::F = a.map(|x| x as f32);
        exp2_int(a: Self::I) -> Self::F = a.map(|x| f32::from_bits(((x + 127) as u32) << 23));
    }
}
