//! How much a part turns along its way, by recorded rotations.
//!
//! The rotation vector of a hinge grows along the arc by the bend; that of a slide stays. Its slope is found
//! by a regression on the length along the curve, under a noise of its own that wanders like that of the
//! positions.

use nalgebra::{DMatrix, Matrix3, Matrix3x2, Vector2, Vector3};

use crate::{
    track::{bend::BendLikelihood, curve::PathCurve, fit::ROUNDING},
    wander::{Gate, Wander, Whitened},
};
use numeric::statistics::{SIGMAS_PER_MAD, median};

/// Volume of all rotations, cubic radians.
/// derived: that of the unit quaternions up to sign, in rotation vectors.
const ALL_ROTATIONS: f64 = 8.0 * std::f64::consts::PI * std::f64::consts::PI;
/// Groups of samples by whose medians a regression starts.
/// chosen: enough for a slope, and few enough for a median in each.
const GROUPS: usize = 9;
/// Channels of a rotation.
/// derived: rotation vectors have three coordinates.
const CHANNELS: f64 = 3.0;
/// Passes of the regression, each with the spread and the outliers of the one before.
/// chosen: the outliers settle in two.
const PASSES: usize = 4;

/// Turn along the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spin {
    /// Slope of the rotation vector, radians per meter.
    pub slope: Vector3<f64>,
    /// Covariance of the slope.
    pub covariance: Matrix3<f64>,
    /// Log likelihood at this slope, averaged over the mean rotation.
    pub peak: f64,
    /// Root mean square of what the slope leaves, radians.
    pub rms_rad: f64,
    /// Number of outliers.
    pub outliers: usize,
}

impl Spin {
    /// The slope of rotation vectors, radians, on lengths, meters; under the most likely correlation.
    #[must_use]
    pub fn along(spins: &[Vector3<f64>], along: &[f64], clock: &[f64]) -> Option<Self> {
        let start = start_slope(spins, along)?;
        let found = Wander::all().filter_map(|wander| regression(spins, along, clock, &start, wander));
        found.max_by(|a, b| a.peak.total_cmp(&b.peak))
    }

    /// Log likelihood of a slope.
    #[must_use]
    pub fn log_likelihood(&self, slope: &Vector3<f64>) -> f64 {
        self.peak - 0.5 * self.misfit(slope)
    }

    /// Squared distance of a slope in deviations.
    #[must_use]
    pub fn misfit(&self, slope: &Vector3<f64>) -> f64 {
        let off = slope - self.slope;
        self.covariance.try_inverse().map_or(0.0, |inverse| off.dot(&(inverse * off)))
    }

    /// The same with a covariance that explains a misfit as chance, if it is more than chance.
    #[must_use]
    pub fn widened(&self, misfit: f64) -> Self {
        let factor = (misfit / CHANNELS).max(1.0);
        // The density of the data drops with the wider slope, for a hinge as for a slide.
        Self { covariance: self.covariance * factor, ..*self }
    }

    /// Log likelihood of the bend of a curve.
    #[must_use]
    pub fn bend_likelihood(&self, curve: &PathCurve) -> Option<BendLikelihood> {
        let inverse = self.covariance.try_inverse()?;
        let [first, second] = curve.across;
        // The spin of a curve is linear in its bend.
        let spins = Matrix3x2::from_columns(&[second, -first]);
        let information = spins.transpose() * inverse * spins;
        let mean: Vector2<f64> = information.try_inverse()? * (spins.transpose() * (inverse * self.slope));
        Some(BendLikelihood { mean, information, peak: self.log_likelihood(&(spins * mean)) })
    }
}

/// Middle rotation vector and slope from medians of groups by length, and the squares of the deviations.
struct StartSlope {
    offset: Vector3<f64>,
    slope: Vector3<f64>,
    variance: Vector3<f64>,
}

fn start_slope(spins: &[Vector3<f64>], along: &[f64]) -> Option<StartSlope> {
    let mut order: Vec<usize> = (0..spins.len()).collect();
    order.sort_by(|a, b| along[*a].total_cmp(&along[*b]));
    let mut sums = [0.0; 3];
    let mut offset = Vector3::zeros();
    let mut moment = Vector3::zeros();
    for group in order.chunks(spins.len().div_ceil(GROUPS).max(1)) {
        let length = median(group.iter().map(|k| along[*k]).collect())?;
        let middle = medians(group.iter().map(|k| spins[*k]))?;
        sums = [sums[0] + 1.0, sums[1] + length, sums[2] + length * length];
        offset += middle;
        moment += middle * length;
    }
    let [count, first, second] = sums;
    let spread = count * second - first * first;
    let slope = if spread > 0.0 { (moment * count - offset * first) / spread } else { Vector3::zeros() };
    let offset = (offset - slope * first) / count;
    let off = medians(spins.iter().zip(along).map(|(w, a)| (w - offset - slope * *a).abs()))?;
    let variance = off.map(|d| (SIGMAS_PER_MAD * d).powi(2) + ROUNDING * ROUNDING);
    Some(StartSlope { offset, slope, variance })
}

/// Medians of each coordinate.
fn medians(vectors: impl Iterator<Item = Vector3<f64>> + Clone) -> Option<Vector3<f64>> {
    let of = |c: usize| median(vectors.clone().map(|v| v[c]).collect());
    Some(Vector3::new(of(0)?, of(1)?, of(2)?))
}

/// The regression under one correlation.
fn regression(
    spins: &[Vector3<f64>],
    along: &[f64],
    clock: &[f64],
    start: &StartSlope,
    wander: Wander,
) -> Option<Spin> {
    let mut offset = start.offset;
    let mut slope = start.slope;
    let mut spread = DMatrix::from_diagonal(&nalgebra::DVector::from_column_slice(start.variance.as_slice()));
    let mut found = None;
    for _ in 0..PASSES {
        let mut rows = DMatrix::zeros(5, spins.len());
        for (k, (spin, length)) in spins.iter().zip(along).enumerate() {
            rows.fixed_view_mut::<3, 1>(0, k).copy_from(&(spin - offset - slope * *length));
            rows[(3, k)] = 1.0;
            rows[(4, k)] = *length;
        }
        let whitened = wander.whitened(clock, &rows, &Gate::new(&spread, ALL_ROTATIONS)?);
        let basis = whitened.rows.rows(3, 2).clone_owned();
        let residuals = whitened.rows.rows(0, 3).clone_owned();
        let inverse = (&basis * basis.transpose()).try_inverse()?;
        let change = &residuals * basis.transpose() * &inverse;
        let left = &residuals - &change * &basis;
        offset += change.fixed_view::<3, 1>(0, 0);
        slope += change.fixed_view::<3, 1>(0, 1);
        let count = whitened.used.iter().filter(|u| **u).count();
        // Two parameters of each channel.
        spread = &left * left.transpose() / (count as f64 - 2.0).max(1.0)
            + DMatrix::identity(3, 3) * ROUNDING * ROUNDING;
        let gate = Gate::new(&spread, ALL_ROTATIONS)?;
        let mut innovations = whitened.rows.clone_owned();
        innovations.rows_mut(0, 3).copy_from(&left);
        let whitened = Whitened { rows: innovations, ..whitened };
        let covariance = Matrix3::from_fn(|r, c| spread[(r, c)] * inverse[(1, 1)]);
        // The mean rotation is averaged out.
        let averaged = -CHANNELS / 2.0 * basis.row(0).norm_squared().ln();
        let spread_log = 0.5 * spread.determinant().ln();
        let peak = gate.log_likelihood(&whitened) + averaged + spread_log;
        let rms_rad = spread.trace().sqrt();
        found = Some(Spin { slope, covariance, peak, rms_rad, outliers: spins.len() - count });
    }
    found
}
