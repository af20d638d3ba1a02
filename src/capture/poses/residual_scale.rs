//! Scale of residuals: their robust standard deviation after normalization.

use super::surfels::Residual;
use numeric::statistics::{SIGMAS_PER_MAD, median};

/// One in this many residuals enters the median.
pub(super) const MEDIAN_EVERY: usize = 4;

/// Sampled normalized residuals of a pair.
#[derive(Default)]
pub(super) struct Ratios {
    seen: usize,
    kept: Vec<f64>,
}

impl Ratios {
    /// Takes the next residual.
    pub fn add(&mut self, r: &Residual) {
        if self.seen.is_multiple_of(MEDIAN_EVERY) {
            self.kept.push(r.distance_m.abs() / r.sigma_m);
        }
        self.seen += 1;
    }
}

/// Robust standard deviation of the normalized residuals, at least 1.
pub(super) fn robust_scale(ratios: Vec<Ratios>) -> f64 {
    (SIGMAS_PER_MAD * median(ratios.into_iter().flat_map(|r| r.kept).collect()).unwrap_or(0.0)).max(1.0)
}
