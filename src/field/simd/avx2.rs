//! Eight lanes: AVX2 and FMA.

use std::arch::x86_64::*;

use super::lanes::{Lanes, lane_methods};

/// Token: the processor has AVX2 and FMA.
#[derive(Clone, Copy)]
pub(super) struct Avx2(());

impl Avx2 {
    /// # Safety
    /// The processor has AVX2 and FMA.
    #[inline(always)]
    pub(super) unsafe fn assume() -> Self {
        Self(())
    }
}

/// Adds `weight * (a, b)` to the pair at `at`.
///
/// # Safety
/// `at` and `at + 1` are readable and writable; the processor has FMA.
#[inline(always)]
pub(super) unsafe fn add_pair(at: *mut f32, weight: f32, pair: (f32, f32)) {
    // SAFETY: the caller's promise; a double is the size of the pair and needs no alignment here.
    unsafe {
        let old = _mm_castpd_ps(_mm_load_sd(at.cast()));
        let sum = _mm_fmadd_ps(_mm_set1_ps(weight), _mm_setr_ps(pair.0, pair.1, 0.0, 0.0), old);
        _mm_store_sd(at.cast(), _mm_castps_pd(sum));
    }
}

/// The intrinsics below are safe to call, because the token proves the features.
macro_rules! has {
    ($e:expr) => {
        // SAFETY: `self` exists only where the processor has the features (see `assume`).
        unsafe { $e }
    };
}

impl Lanes for Avx2 {
    type F = __m256;
    type I = __m256i;
    const N: usize = 8;
    const TILE: usize = 2;

    #[inline(always)]
    unsafe fn load(self, at: *const f32) -> __m256 {
        // SAFETY: the caller's promise.
        unsafe { _mm256_loadu_ps(at) }
    }
    #[inline(always)]
    unsafe fn store(self, at: *mut f32, value: __m256) {
        // SAFETY: the caller's promise.
        unsafe { _mm256_storeu_ps(at, value) }
    }
    #[inline(always)]
    unsafe fn store_int(self, at: *mut i32, value: __m256i) {
        // SAFETY: the caller's promise.
        unsafe { _mm256_storeu_si256(at.cast(), value) }
    }
    #[inline(always)]
    unsafe fn gather_pairs(self, table: *const f32, index: __m256i) -> (__m256, __m256) {
        // SAFETY: the caller promises that every pair lies in the table.
        unsafe {
            // A pair of floats is gathered as one double. The shuffle works within register halves; the
            // permutation restores the order.
            let low = _mm256_castpd_ps(_mm256_i32gather_pd::<8>(table.cast(), _mm256_castsi256_si128(index)));
            let high = _mm256_castpd_ps(_mm256_i32gather_pd::<8>(
                table.cast(),
                _mm256_extracti128_si256::<1>(index),
            ));
            let even = _mm256_castps_pd(_mm256_shuffle_ps::<0x88>(low, high));
            let odd = _mm256_castps_pd(_mm256_shuffle_ps::<0xdd>(low, high));
            (
                _mm256_castpd_ps(_mm256_permute4x64_pd::<0xd8>(even)),
                _mm256_castpd_ps(_mm256_permute4x64_pd::<0xd8>(odd)),
            )
        }
    }
    #[inline(always)]
    unsafe fn add_pair(self, at: *mut f32, weight: f32, pair: (f32, f32)) {
        // SAFETY: the caller's promise; the token proves FMA.
        unsafe { add_pair(at, weight, pair) }
    }

    lane_methods! {
        has:
        splat(value: f32) -> Self::F = _mm256_set1_ps(value);
        add(a: Self::F, b: Self::F) -> Self::F = _mm256_add_ps(a, b);
        sub(a: Self::F, b: Self::F) -> Self::F = _mm256_sub_ps(a, b);
        mul(a: Self::F, b: Self::F) -> Self::F = _mm256_mul_ps(a, b);
        div(a: Self::F, b: Self::F) -> Self::F = _mm256_div_ps(a, b);
        fma(a: Self::F, b: Self::F, c: Self::F) -> Self::F = _mm256_fmadd_ps(a, b, c);
        max(a: Self::F, b: Self::F) -> Self::F = _mm256_max_ps(a, b);
        min(a: Self::F, b: Self::F) -> Self::F = _mm256_min_ps(a, b);
        sqrt(a: Self::F) -> Self::F = _mm256_sqrt_ps(a);
        keep_above(test: Self::F, bound: Self::F, value: Self::F) -> Self::F =
            _mm256_and_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(test, bound), value);
        abs(a: Self::F) -> Self::F = _mm256_andnot_ps(_mm256_set1_ps(-0.0), a);
        sum4([a, b, c, d]: [Self::F; 4]) -> [f32; 4] = {
            let ab = _mm256_add_ps(_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
            let cd = _mm256_add_ps(_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
            let abcd = _mm256_add_ps(_mm256_shuffle_ps::<0x44>(ab, cd), _mm256_shuffle_ps::<0xee>(ab, cd));
            let sums = _mm_add_ps(_mm256_castps256_ps128(abcd), _mm256_extractf128_ps::<1>(abcd));
            let mut out = [0.0; 4];
            _mm_storeu_ps(out.as_mut_ptr(), sums);
            out
        };
        splat_int(value: i32) -> Self::I = _mm256_set1_epi32(value);
        add_int(a: Self::I, b: Self::I) -> Self::I = _mm256_add_epi32(a, b);
        mul_int(a: Self::I, b: Self::I) -> Self::I = _mm256_mullo_epi32(a, b);
        xor(a: Self::I, b: Self::I) -> Self::I = _mm256_xor_si256(a, b);
        and(a: Self::I, b: Self::I) -> Self::I = _mm256_and_si256(a, b);
        clamp_int(a: Self::I, low: i32, high: i32) -> Self::I =
            _mm256_min_epi32(_mm256_max_epi32(a, _mm256_set1_epi32(low)), _mm256_set1_epi32(high));
        truncate(a: Self::F) -> Self::I = _mm256_cvttps_epi32(a);
        float(a: Self::I) -> Self::F = _mm256_cvtepi32_ps(a);
        // Writes the exponent bits directly; they are biased by 127.
        exp2_int(a: Self::I) -> Self::F =
            _mm256_castsi256_ps(_mm256_slli_epi32::<23>(_mm256_add_epi32(a, _mm256_set1_epi32(127))));
    }
}
