//! One user seed, one independent random stream per stage and step, and draws from a stream.

use std::f64::consts::TAU;

use nalgebra::{Unit, Vector3};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// A stream of random numbers.
pub type StageRng = Pcg64Mcg;

/// The random stream of a step of a stage. It is independent of other stages and steps: a resumed run draws
/// the same as an uninterrupted one, and a new stage does not change the others.
pub fn stage_rng(seed: u64, stage: &str, step: u64) -> StageRng {
    let name = hash_of(stage);
    let mut bytes = [0; 16];
    // Both halves are mixed, so neighboring seeds and steps have unrelated streams.
    bytes[..8].copy_from_slice(&split_mix(seed ^ split_mix(name)).to_le_bytes());
    bytes[8..].copy_from_slice(&split_mix(name ^ split_mix(step)).to_le_bytes());
    Pcg64Mcg::from_seed(bytes)
}

/// FNV-1a of a text: a short number for a name, the same on every machine.
pub fn hash_of(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3))
}

/// Increment of SplitMix64 from one number of a stream to the next (Steele, Lea and Flood 2014).
pub const STREAM_STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// The number that SplitMix64 gives for a state.
pub fn split_mix(mut x: u64) -> u64 {
    x = x.wrapping_add(STREAM_STEP);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// Uniform in `[0, 1)` from the 53 upper bits, as many as a double's mantissa has.
pub fn unit_of(bits: u64) -> f64 {
    (bits >> 11) as f64 / (1u64 << 53) as f64
}

/// Uniform in `[0, 1)`.
pub fn unit_uniform(rng: &mut impl Rng) -> f64 {
    unit_of(rng.next_u64())
}

/// Uniform in `[low, high)`.
pub fn uniform_in(rng: &mut impl Rng, low: f64, high: f64) -> f64 {
    low + (high - low) * unit_uniform(rng)
}

/// Uniform in `0..n`; 0 for `n = 0`.
pub fn index_below(rng: &mut impl Rng, n: usize) -> usize {
    // The product may round up to n.
    ((unit_uniform(rng) * n as f64) as usize).min(n.saturating_sub(1))
}

/// True with the given probability.
pub fn is_chosen(rng: &mut impl Rng, probability: f64) -> bool {
    unit_uniform(rng) < probability
}

/// Standard normal (Box and Muller 1958).
pub fn standard_normal(rng: &mut impl Rng) -> f64 {
    // In (0, 1], because the logarithm of 0 is not finite.
    let radius = (-2.0 * (1.0 - unit_uniform(rng)).ln()).sqrt();
    radius * (TAU * unit_uniform(rng)).cos()
}

/// A vector of three independent normals; `rms` is its root mean square length.
pub fn isotropic_normal(rng: &mut impl Rng, rms: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| standard_normal(rng)) * (rms / 3f64.sqrt())
}

/// A unit direction, uniform on the sphere.
pub fn random_direction(rng: &mut impl Rng) -> Unit<Vector3<f64>> {
    // The area of a sphere between two heights is proportional to their difference (Archimedes).
    let z = uniform_in(rng, -1.0, 1.0);
    let azimuth = uniform_in(rng, 0.0, TAU);
    let across = (1.0 - z * z).sqrt();
    Unit::new_normalize(Vector3::new(across * azimuth.cos(), across * azimuth.sin(), z))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_are_repeatable_and_distinct() {
        let first = |s, n, k| stage_rng(s, n, k).next_u64();
        assert_eq!(first(7, "field/state0", 3), first(7, "field/state0", 3));
        for other in [
            first(8, "field/state0", 3),
            first(7, "field/state1", 3),
            first(7, "field/state0", 4),
            first(7 + (1 << 40), "field/state0", 3),
        ] {
            assert_ne!(first(7, "field/state0", 3), other);
        }
    }

    #[test]
    fn moments_are_right() {
        let rng = &mut stage_rng(3, "draw", 0);
        let n = 40_000;
        let normals: Vec<f64> = (0..n).map(|_| standard_normal(rng)).collect();
        let mean = normals.iter().sum::<f64>() / f64::from(n);
        let variance = normals.iter().map(|x| x * x).sum::<f64>() / f64::from(n);
        assert!(mean.abs() < 0.02 && (variance - 1.0).abs() < 0.03);
        let square = (0..n).map(|_| isotropic_normal(rng, 0.5).norm_squared()).sum::<f64>() / f64::from(n);
        assert!((square.sqrt() - 0.5).abs() < 0.01);
        let sum: Vector3<f64> = (0..n).map(|_| random_direction(rng).into_inner()).sum();
        assert!((sum / f64::from(n)).norm() < 0.02);
        assert!((0..n).all(|_| index_below(rng, 3) < 3) && index_below(rng, 0) == 0);
    }
}
