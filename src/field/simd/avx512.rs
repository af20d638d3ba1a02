//! Sixteen lanes: AVX-512 F and DQ.

use std::arch::x86_64::*;

use super::lanes::{Lanes, lane_methods};

/// Token: the processor has AVX-512 F and DQ, AVX2 and FMA.
#[derive(Clone, Copy)]
pub(super) struct Avx512(());

impl Avx512 {
    /// # Safety
    /// The processor has AVX-512 F and DQ, AVX2 and FMA.
    #[inline(always)]
    pub(super) unsafe fn assume() -> Self {
        Self(())
    }
}

/// The intrinsics below are safe to call, because the token proves the features.
macro_rules! has {
    ($e:expr) => {
        // SAFETY: `self` exists only where the processor has the features (see `assume`).
        unsafe { $e }
    };
}

impl Lanes for Avx512 {
    type F = __m512;
    type I = __m512i;
    const N: usize = 16;
    const TILE: usize = 4;

    #[inline(always)]
    unsafe fn load(self, at: *const f32) -> __m512 {
        // SAFETY: the caller's promise.
        unsafe { _mm512_loadu_ps(at) }
    }
    #[inline(always)]
    unsafe fn store(self, at: *mut f32, value: __m512) {
        // SAFETY: the caller's promise.
        unsafe { _mm512_storeu_ps(at, value) }
    }
    #[inline(always)]
    unsafe fn store_int(self, at: *mut i32, value: __m512i) {
        // SAFETY: the caller's promise.
        unsafe { _mm512_storeu_si512(at.cast(), value) }
    }
    #[inline(always)]
    unsafe fn gather_pairs(self, table: *const f32, index: __m512i) -> (__m512, __m512) {
        // SAFETY: the caller promises that every pair lies in the table.
        unsafe {
            // A pair of floats is gathered as one double, which halves the reads.
            let low = _mm512_i32gather_pd::<8>(_mm512_castsi512_si256(index), table.cast());
            let high = _mm512_i32gather_pd::<8>(_mm512_extracti64x4_epi64::<1>(index), table.cast());
            let low = _mm512_castpd_ps(low);
            let high = _mm512_castpd_ps(high);
            let even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
            let odd = _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
            (_mm512_permutex2var_ps(low, even, high), _mm512_permutex2var_ps(low, odd, high))
        }
    }
    #[inline(always)]
    unsafe fn add_pair(self, at: *mut f32, weight: f32, pair: (f32, f32)) {
        // SAFETY: the caller's promise.
        unsafe { super::avx2::add_pair(at, weight, pair) }
    }

    lane_methods! {
        has:
        splat(value: f32) -> Self::F = _mm512_set1_ps(value);
        add(a: Self::F, b: Self::F) -> Self::F = _mm512_add_ps(a, b);
        sub(a: Self::F, b: Self::F) -> Self::F = _mm512_sub_ps(a, b);
        mul(a: Self::F, b: Self::F) -> Self::F = _mm512_mul_ps(a, b);
        div(a: Self::F, b: Self::F) -> Self::F = _mm512_div_ps(a, b);
        fma(a: Self::F, b: Self::F, c: Self::F) -> Self::F = _mm512_fmadd_ps(a, b, c);
        max(a: Self::F, b: Self::F) -> Self::F = _mm512_max_ps(a, b);
        min(a: Self::F, b: Self::F) -> Self::F = _mm512_min_ps(a, b);
        sqrt(a: Self::F) -> Self::F = _mm512_sqrt_ps(a);
        keep_above(test: Self::F, bound: Self::F, value: Self::F) -> Self::F =
            _mm512_maskz_mov_ps(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(test, bound), value);
        abs(a: Self::F) -> Self::F = _mm512_abs_ps(a);
        sum4([a, b, c, d]: [Self::F; 4]) -> [f32; 4] = {
            let ab = _mm512_add_ps(_mm512_unpacklo_ps(a, b), _mm512_unpackhi_ps(a, b));
            let cd = _mm512_add_ps(_mm512_unpacklo_ps(c, d), _mm512_unpackhi_ps(c, d));
            let abcd = _mm512_add_ps(_mm512_shuffle_ps::<0x44>(ab, cd), _mm512_shuffle_ps::<0xee>(ab, cd));
            let half = _mm256_add_ps(_mm512_castps512_ps256(abcd), _mm512_extractf32x8_ps::<1>(abcd));
            let sums = _mm_add_ps(_mm256_castps256_ps128(half), _mm256_extractf128_ps::<1>(half));
            let mut out = [0.0; 4];
            _mm_storeu_ps(out.as_mut_ptr(), sums);
            out
        };
        splat_int(value: i32) -> Self::I = _mm512_set1_epi32(value);
        add_int(a: Self::I, b: Self::I) -> Self::I = _mm512_add_epi32(a, b);
        mul_int(a: Self::I, b: Self::I) -> Self::I = _mm512_mullo_epi32(a, b);
        xor(a: Self::I, b: Self::I) -> Self::I = _mm512_xor_si512(a, b);
        and(a: Self::I, b: Self::I) -> Self::I = _mm512_and_si512(a, b);
        clamp_int(a: Self::I, low: i32, high: i32) -> Self::I =
            _mm512_min_epi32(_mm512_max_epi32(a, _mm512_set1_epi32(low)), _mm512_set1_epi32(high));
        truncate(a: Self::F) -> Self::I = _mm512_cvttps_epi32(a);
        float(a: Self::I) -> Self::F = _mm512_cvtepi32_ps(a);
        exp2_int(a: Self::I) -> Self::F =
            _mm512_castsi512_ps(_mm512_slli_epi32::<23>(_mm512_add_epi32(a, _mm512_set1_epi32(127))));
    }
}
