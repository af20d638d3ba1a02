//! Random numbers of a few kinds, drawn from a generator that was passed in.

use rand_core::Rng;

/// Uniform in `[0, 1)`.
pub(super) fn unit(rng: &mut impl Rng) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// Uniform in `[low, high)`.
pub(super) fn range(rng: &mut impl Rng, low: f64, high: f64) -> f64 {
    low + (high - low) * unit(rng)
}

/// Uniform in `0..n`; 0 for `n = 0`.
pub(super) fn below(rng: &mut impl Rng, n: usize) -> usize {
    ((unit(rng) * n as f64) as usize).min(n.saturating_sub(1))
}

/// True with the given probability.
pub(super) fn chance(rng: &mut impl Rng, probability: f64) -> bool {
    unit(rng) < probability
}

/// Standard normal (Box and Muller 1958).
pub(super) fn normal(rng: &mut impl Rng) -> f64 {
    let radius = (-2.0 * (1.0 - unit(rng)).ln()).sqrt();
    radius * (std::f64::consts::TAU * unit(rng)).cos()
}

/// A vector of three independent normals whose root mean square length is `rms`.
pub(super) fn isotropic(rng: &mut impl Rng, rms: f64) -> nalgebra::Vector3<f64> {
    nalgebra::Vector3::from_fn(|_, _| normal(rng)) * (rms / 3f64.sqrt())
}

/// A unit direction, uniform on the sphere.
pub(super) fn direction(rng: &mut impl Rng) -> nalgebra::Unit<nalgebra::Vector3<f64>> {
    let z = range(rng, -1.0, 1.0);
    let azimuth = range(rng, 0.0, std::f64::consts::TAU);
    let across = (1.0 - z * z).sqrt();
    nalgebra::Unit::new_normalize(nalgebra::Vector3::new(across * azimuth.cos(), across * azimuth.sin(), z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::stage_rng;

    #[test]
    fn moments_are_right() {
        let rng = &mut stage_rng(3, "draw", 0);
        let n = 40_000;
        let normals: Vec<f64> = (0..n).map(|_| normal(rng)).collect();
        let mean = normals.iter().sum::<f64>() / f64::from(n);
        let variance = normals.iter().map(|x| x * x).sum::<f64>() / f64::from(n);
        assert!(mean.abs() < 0.02 && (variance - 1.0).abs() < 0.03);
        let square = (0..n).map(|_| isotropic(rng, 0.5).norm_squared()).sum::<f64>() / f64::from(n);
        assert!((square.sqrt() - 0.5).abs() < 0.01);
        let sum: nalgebra::Vector3<f64> = (0..n).map(|_| direction(rng).into_inner()).sum();
        assert!((sum / f64::from(n)).norm() < 0.02);
        assert!((0..n).all(|_| below(rng, 3) < 3) && below(rng, 0) == 0);
    }
}
