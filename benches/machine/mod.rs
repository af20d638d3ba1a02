//! What the processor reaches with all threads together, measured: multiplications and additions in
//! registers, bytes of memory, readings at places out of order.

#![allow(dead_code, reason = "each bench asks for some of it")]

use std::{hint::black_box, time::Instant};

use rayon::prelude::*;

/// Numbers of a block of memory that no cache holds.
const BLOCK: usize = 1 << 26;
/// Repetitions of which the best counts.
const REPEATS: usize = 5;

/// Most gigabytes a second that memory gives to sums over it.
pub fn read_gbytes_per_s() -> f64 {
    let block = vec![1.0f32; BLOCK];
    let some = BLOCK / rayon::current_num_threads();
    let sum = |part: &[f32]| {
        // As many sums side by side as registers hold.
        let mut lanes = [0.0f32; 64];
        part.chunks_exact(64).for_each(|c| lanes.iter_mut().zip(c).for_each(|(lane, x)| *lane += x));
        lanes.iter().sum::<f32>()
    };
    let seconds = best(|| _ = black_box(block.par_chunks(some).map(sum).sum::<f32>()));
    (4 * BLOCK) as f64 / seconds / 1e9
}

/// Most readings of four bytes a second, in 1e9, at places out of order in an image of so many pixels.
pub fn readings_per_ns(pixels: usize) -> f64 {
    let image: Vec<f32> = (0..pixels).map(|i| i as f32).collect();
    let places: Vec<u32> = (0..1u32 << 22).map(|i| i.wrapping_mul(2_654_435_761) % pixels as u32).collect();
    let threads = rayon::current_num_threads();
    let read = |_| {
        let mut lanes = [0.0f32; 8];
        for places in places.chunks_exact(8) {
            lanes.iter_mut().zip(places).for_each(|(lane, &i)| *lane += image[i as usize]);
        }
        lanes.iter().sum::<f32>()
    };
    let seconds = best(|| _ = black_box((0..threads).into_par_iter().map(read).sum::<f32>()));
    (threads * places.len()) as f64 / seconds / 1e9
}

fn best(work: impl Fn()) -> f64 {
    let once = |_| {
        let begin = Instant::now();
        work();
        begin.elapsed().as_secs_f64()
    };
    (0..REPEATS).map(once).fold(f64::INFINITY, f64::min)
}

/// Most multiplications and additions a second that all threads reach together in registers, in 1e9.
pub fn peak_gflops() -> f64 {
    const CHAINED: usize = 2_000_000;
    let threads = rayon::current_num_threads();
    let begin = Instant::now();
    let flops: f64 = (0..threads).into_par_iter().map(|_| fused(CHAINED)).sum();
    flops / begin.elapsed().as_secs_f64() / 1e9
}

/// Runs twelve independent chains of vector FMAs; the number of operations.
fn fused(repeats: usize) -> f64 {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::*;
        #[target_feature(enable = "avx512f")]
        fn wide(repeats: usize) -> f64 {
            let (a, b) = (_mm512_set1_ps(black_box(0.999)), _mm512_set1_ps(black_box(0.001)));
            let mut chains: [_; 12] = std::array::from_fn(|k| _mm512_set1_ps(black_box(k as f32)));
            for _ in 0..repeats {
                chains.iter_mut().for_each(|c| *c = _mm512_fmadd_ps(*c, a, b));
            }
            chains.into_iter().for_each(|c| _ = black_box(_mm512_reduce_add_ps(c)));
            (2 * 16 * 12 * repeats) as f64
        }
        #[target_feature(enable = "avx2,fma")]
        fn narrow(repeats: usize) -> f64 {
            let (a, b) = (_mm256_set1_ps(black_box(0.999)), _mm256_set1_ps(black_box(0.001)));
            let mut chains: [_; 12] = std::array::from_fn(|k| _mm256_set1_ps(black_box(k as f32)));
            for _ in 0..repeats {
                chains.iter_mut().for_each(|c| *c = _mm256_fmadd_ps(*c, a, b));
            }
            chains.into_iter().for_each(|c| _ = black_box(_mm256_cvtss_f32(c)));
            (2 * 8 * 12 * repeats) as f64
        }
        if is_x86_feature_detected!("avx512f") {
            // SAFETY: the feature was detected.
            return unsafe { wide(repeats) };
        }
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // SAFETY: the features were detected.
            return unsafe { narrow(repeats) };
        }
    }
    let mut chains = [1.0f32; 12];
    for _ in 0..repeats {
        chains.iter_mut().for_each(|c| *c = black_box(*c * 0.999 + 0.001));
    }
    (2 * 12 * repeats) as f64
}
