//! Evidence for a bend: the odds of a circle against a line.
//!
//! Both have the same offsets and tilts. Averaged over these, the likelihood is a function of the bend, a
//! normal density about the fitted one. A line is its value at zero, a circle its mean over the bends that
//! hinges have: all directions alike, all orders of magnitude of the radius alike.
//! See docs/method.md (14.21).

use nalgebra::{Matrix2, Vector2};

/// Least radius of a hinge's path, meters.
/// chosen: a knob.
const LEAST_RADIUS_M: f64 = 0.05;
/// Largest radius of a hinge's path, meters.
/// chosen: a large gate; a bend below its is that of a rail.
const LARGEST_RADIUS_M: f64 = 2.0;
/// Radii and directions over which a broad likelihood is averaged.
/// chosen: finer than any likelihood that is not averaged in closed form.
const RADII: usize = 200;
const DIRECTIONS: usize = 180;
/// Deviation of a bend, as a share of it, below which the prior is constant over the likelihood.
/// chosen: the prior then changes by a fifth within one deviation.
const NARROW: f64 = 0.1;

/// Log likelihood of a bend, averaged over the other parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BendLikelihood {
    /// The most likely bend, 1/m.
    pub mean: Vector2<f64>,
    /// Inverse covariance, square meters.
    pub information: Matrix2<f64>,
    /// Log likelihood of the most likely bend.
    pub peak: f64,
}

impl BendLikelihood {
    /// The mean over the bends of hinges, as a logarithm.
    #[must_use]
    pub fn log_evidence(&self) -> f64 {
        let Some(covariance) = self.information.try_inverse() else { return self.peak };
        let bend = self.mean.norm();
        let orders = (LARGEST_RADIUS_M / LEAST_RADIUS_M).ln();
        let widest = covariance.symmetric_eigenvalues().max().max(0.0).sqrt();
        if widest < NARROW * bend && (LEAST_RADIUS_M..LARGEST_RADIUS_M).contains(&(1.0 / bend)) {
            let volume = std::f64::consts::TAU * covariance.determinant().sqrt();
            return self.peak + (volume / (std::f64::consts::TAU * bend * bend * orders)).ln();
        }
        let mut logs = Vec::with_capacity(RADII * DIRECTIONS);
        for r in 0..RADII {
            let radius = LARGEST_RADIUS_M * (-orders * (r as f64 + 0.5) / RADII as f64).exp();
            for d in 0..DIRECTIONS {
                let angle = std::f64::consts::TAU * d as f64 / DIRECTIONS as f64;
                let off = Vector2::new(angle.cos(), angle.sin()) / radius - self.mean;
                logs.push(-0.5 * off.dot(&(self.information * off)));
            }
        }
        let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let mean = logs.iter().map(|l| (l - most).exp()).sum::<f64>() / logs.len() as f64;
        self.peak + most + mean.ln()
    }

    /// The likelihood times another normal density of the bend: its mean, information and peak.
    #[must_use]
    pub fn times(&self, other: &Self) -> Self {
        let information = self.information + other.information;
        let Some(covariance) = information.try_inverse() else { return *self };
        let mean = covariance * (self.information * self.mean + other.information * other.mean);
        let misfit = |one: &Self| (mean - one.mean).dot(&(one.information * (mean - one.mean)));
        let peak = self.peak + other.peak - 0.5 * (misfit(self) + misfit(other));
        Self { mean, information, peak }
    }
}
