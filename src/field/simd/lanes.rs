//! The vector operations used by the kernels.

/// Columns come in multiples of this on every instruction set, so that the layout is the same.
pub(crate) const COLUMN_ALIGN: usize = 16;

/// A vector of `N` single floats and one of `N` 32-bit integers of an instruction set. The value itself is a
/// token: it exists only where the processor has the set.
pub(crate) trait Lanes: Copy {
    /// Floats.
    type F: Copy;
    /// Integers.
    type I: Copy;
    /// Number of lanes; it divides [`COLUMN_ALIGN`].
    const N: usize;
    /// Number of vectors along the columns of a matrix tile.
    const TILE: usize;

    /// Loads `N` floats.
    ///
    /// # Safety
    /// `at..at + N` is readable.
    unsafe fn load(self, at: *const f32) -> Self::F;
    /// Stores `N` floats.
    ///
    /// # Safety
    /// `at..at + N` is writable.
    unsafe fn store(self, at: *mut f32, value: Self::F);
    /// Stores `N` integers.
    ///
    /// # Safety
    /// `at..at + N` is writable.
    unsafe fn store_int(self, at: *mut i32, value: Self::I);
    /// Reads the pairs of floats `table[2 i], table[2 i + 1]`.
    ///
    /// # Safety
    /// Every `2 i + 1` lies in the table.
    unsafe fn gather_pairs(self, table: *const f32, index: Self::I) -> (Self::F, Self::F);
    /// Adds `weight * (a, b)` to the pair of floats at `at`.
    ///
    /// # Safety
    /// `at` and `at + 1` are readable and writable.
    #[inline(always)]
    unsafe fn add_pair(self, at: *mut f32, weight: f32, pair: (f32, f32)) {
        // SAFETY: the caller's promise.
        unsafe {
            *at += weight * pair.0;
            *at.add(1) += weight * pair.1;
        }
    }

    /// The same float in every lane.
    fn splat(self, value: f32) -> Self::F;
    /// `a + b`.
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a - b`.
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a * b`.
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a / b`.
    fn div(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a * b + c`.
    fn fma(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// Larger of the two; `b` where `a` is NaN.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// Smaller of the two; `b` where `a` is NaN.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// Square root.
    fn sqrt(self, a: Self::F) -> Self::F;
    /// `value` where `test > bound`, else 0.
    fn keep_above(self, test: Self::F, bound: Self::F, value: Self::F) -> Self::F;
    /// Absolute value.
    fn abs(self, a: Self::F) -> Self::F;
    /// Sums of four vectors, in a fixed order.
    fn sum4(self, v: [Self::F; 4]) -> [f32; 4];

    /// The same integer in every lane.
    fn splat_int(self, value: i32) -> Self::I;
    /// `a + b`, wrapping.
    fn add_int(self, a: Self::I, b: Self::I) -> Self::I;
    /// `a * b`, wrapping.
    fn mul_int(self, a: Self::I, b: Self::I) -> Self::I;
    /// Bitwise exclusive or.
    fn xor(self, a: Self::I, b: Self::I) -> Self::I;
    /// Bitwise and.
    fn and(self, a: Self::I, b: Self::I) -> Self::I;
    /// Limits every lane to `[low, high]`.
    fn clamp_int(self, a: Self::I, low: i32, high: i32) -> Self::I;
    /// Rounds towards zero.
    fn truncate(self, a: Self::F) -> Self::I;
    /// To float.
    fn float(self, a: Self::I) -> Self::F;
    /// `2^a` for `a` in `[-126, 127]`.
    fn exp2_int(self, a: Self::I) -> Self::F;
}

/// Methods of [`Lanes`] of one expression each, wrapped by the macro that is named first.
macro_rules! lane_methods {
    ($wrap:ident: $($name:ident($($argument:tt: $kind:ty),*) -> $result:ty = $value:expr;)*) => {
        $(
            #[inline(always)]
            fn $name(self, $($argument: $kind),*) -> $result {
                $wrap!($value)
            }
        )*
    };
}
pub(super) use lane_methods;
