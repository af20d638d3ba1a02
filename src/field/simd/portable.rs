//! Four lanes in plain Rust; the compiler turns them into SSE2 or NEON.

use std::array::from_fn;

use super::lanes::Lanes;

/// Token: no features needed.
#[derive(Clone, Copy)]
pub(super) struct Portable;

/// `a * b + c`, fused where the baseline has the instruction.
#[inline(always)]
fn fused_multiply_add(a: f32, b: f32, c: f32) -> f32 {
    // Without the instruction, a fused product would call the math library.
    if cfg!(target_arch = "aarch64") { a.mul_add(b, c) } else { a * b + c }
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

    #[inline(always)]
    fn splat(self, value: f32) -> [f32; 4] {
        [value; 4]
    }
    #[inline(always)]
    fn add(self, a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
        from_fn(|i| a[i] + b[i])
    }
    #[inline(always)]
    fn sub(self, a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
        from_fn(|i| a[i] - b[i])
    }
    #[inline(always)]
    fn mul(self, a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
        from_fn(|i| a[i] * b[i])
    }
    #[inline(always)]
    fn div(self, a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
        from_fn(|i| a[i] / b[i])
    }
    #[inline(always)]
    fn fma(self, a: [f32; 4], b: [f32; 4], c: [f32; 4]) -> [f32; 4] {
        from_fn(|i| fused_multiply_add(a[i], b[i], c[i]))
    }
    #[inline(always)]
    fn max(self, a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
        from_fn(|i| if a[i] > b[i] { a[i] } else { b[i] })
    }
    #[inline(always)]
    fn min(self, a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
        from_fn(|i| if a[i] < b[i] { a[i] } else { b[i] })
    }
    #[inline(always)]
    fn sqrt(self, a: [f32; 4]) -> [f32; 4] {
        a.map(f32::sqrt)
    }
    #[inline(always)]
    fn keep_above(self, test: [f32; 4], bound: [f32; 4], value: [f32; 4]) -> [f32; 4] {
        from_fn(|i| if test[i] > bound[i] { value[i] } else { 0.0 })
    }
    #[inline(always)]
    fn abs(self, a: [f32; 4]) -> [f32; 4] {
        a.map(f32::abs)
    }
    #[inline(always)]
    fn sum4(self, v: [[f32; 4]; 4]) -> [f32; 4] {
        v.map(|[a, b, c, d]| (a + b) + (c + d))
    }

    #[inline(always)]
    fn splat_int(self, value: i32) -> [i32; 4] {
        [value; 4]
    }
    #[inline(always)]
    fn add_int(self, a: [i32; 4], b: [i32; 4]) -> [i32; 4] {
        from_fn(|i| a[i].wrapping_add(b[i]))
    }
    #[inline(always)]
    fn mul_int(self, a: [i32; 4], b: [i32; 4]) -> [i32; 4] {
        from_fn(|i| a[i].wrapping_mul(b[i]))
    }
    #[inline(always)]
    fn xor(self, a: [i32; 4], b: [i32; 4]) -> [i32; 4] {
        from_fn(|i| a[i] ^ b[i])
    }
    #[inline(always)]
    fn and(self, a: [i32; 4], b: [i32; 4]) -> [i32; 4] {
        from_fn(|i| a[i] & b[i])
    }
    #[inline(always)]
    fn clamp_int(self, a: [i32; 4], low: i32, high: i32) -> [i32; 4] {
        a.map(|x| x.max(low).min(high))
    }
    #[inline(always)]
    fn truncate(self, a: [f32; 4]) -> [i32; 4] {
        a.map(|x| x as i32)
    }
    #[inline(always)]
    fn float(self, a: [i32; 4]) -> [f32; 4] {
        a.map(|x| x as f32)
    }
    #[inline(always)]
    fn exp2_int(self, a: [i32; 4]) -> [f32; 4] {
        a.map(|x| f32::from_bits(((x + 127) as u32) << 23))
    }
}
