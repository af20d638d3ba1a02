//! Loops compiled for the vector instructions of the running processor.

/// Makes a function from a kernel (an `#[inline(always)]` function) by compiling it for AVX-512, for AVX2 and
/// for any processor; the best version for the running processor is called. None of them fuses products with
/// sums, so all give the same values.
#[macro_export]
macro_rules! vectorized {
    ($(#[$doc:meta])* $vis:vis fn $name:ident($($arg:ident: $ty:ty),* $(,)?) = $kernel:path) => {
        $(#[$doc])*
        $vis fn $name($($arg: $ty),*) {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
                fn avx512($($arg: $ty),*) {
                    $kernel($($arg),*);
                }
                #[target_feature(enable = "avx2")]
                fn avx2($($arg: $ty),*) {
                    $kernel($($arg),*);
                }
                use std::arch::is_x86_feature_detected as has;
                if has!("avx512f") && has!("avx512bw") && has!("avx512dq") && has!("avx512vl") {
                    // SAFETY: the features were found on this processor.
                    return unsafe { avx512($($arg),*) };
                }
                if has!("avx2") {
                    // SAFETY: the feature was found on this processor.
                    return unsafe { avx2($($arg),*) };
                }
            }
            $kernel($($arg),*);
        }
    };
}
