//! The most likely line or circle of a track, with the size and the correlation of what lies off it.

use nalgebra::{DMatrix, DVector, Matrix2};

use crate::{
    track::{
        curve::{CIRCLE, LINE, PathCurve},
        start::start_curve,
        trace::PointTrack,
    },
    wander::{Gate, Wander, Whitened, clock},
};
use numeric::statistics::SIGMAS_PER_MAD;

/// Steps of a fit.
/// chosen: the residuals are nearly linear, and the last steps of all tracks are below rounding.
const STEPS: usize = 6;
/// Steps after which neither the clock nor the outliers change.
/// chosen: the curve is near the best one by then.
const SETTLED: usize = 3;
/// Least deviation, meters or radians: the rounding of the numbers.
/// derived: six decimals, the least number in logs of poses.
pub const ROUNDING: f64 = 1e-6;

/// A curve fitted to a track.
#[derive(Clone, Debug)]
pub struct CurveFit {
    /// The curve.
    pub curve: PathCurve,
    /// Correlation of what lies off it.
    pub wander: Wander,
    /// Covariance of what lies off it in the directions across, square meters.
    pub spread: Matrix2<f64>,
    /// Information of the parameters.
    pub information: DMatrix<f64>,
    /// Log likelihood.
    pub log_likelihood: f64,
    /// Which samples are no outliers.
    pub used: Vec<bool>,
    /// Length along the curve of every sample, meters.
    pub along: Vec<f64>,
    /// Place of every sample on the clock of the errors.
    pub clock: Vec<f64>,
}

impl CurveFit {
    /// The fit of a line, or of a circle; `None` where no curve can be found.
    #[must_use]
    pub fn of_trace(trace: &PointTrack, is_bent: bool) -> Option<Self> {
        let (start, distance) = start_curve(&trace.position, is_bent)?;
        let shares = trace.shares_of_time();
        let spread = Matrix2::identity() * (SIGMAS_PER_MAD * distance).powi(2);
        let fits = Wander::all().filter_map(|w| fitted(trace, &shares, &start, is_bent, &spread, w));
        fits.max_by(|a, b| a.log_evidence().total_cmp(&b.log_evidence()))
    }

    /// Log likelihood with the parameters averaged out, but for a constant.
    #[must_use]
    pub fn log_evidence(&self) -> f64 {
        let log_det = self.information.clone().cholesky().map_or(f64::INFINITY, |c| c.determinant().ln());
        self.log_likelihood - 0.5 * log_det
    }

    /// Least and largest length along the curve of the samples that are no outliers, meters.
    #[must_use]
    pub fn ends(&self) -> [f64; 2] {
        let inliers = || self.along.iter().zip(&self.used).filter(|(_, used)| **used).map(|(a, _)| *a);
        [inliers().fold(f64::INFINITY, f64::min), inliers().fold(f64::NEG_INFINITY, f64::max)]
    }

    /// Root mean square of what lies off the curve, without outliers, meters.
    #[must_use]
    pub fn rms_m(&self, trace: &PointTrack) -> f64 {
        let inliers = trace.position.iter().zip(&self.used).filter(|(_, used)| **used);
        let squares: Vec<f64> = inliers.map(|(p, _)| self.curve.residual(p).0.norm_squared()).collect();
        (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
    }
}

/// The fit under one correlation, from a start with its spread.
fn fitted(
    trace: &PointTrack,
    shares_of_time: &[f64],
    start: &PathCurve,
    is_bent: bool,
    spread: &Matrix2<f64>,
    wander: Wander,
) -> Option<CurveFit> {
    let parameters = if is_bent { CIRCLE } else { LINE };
    let mut curve = *start;
    let mut spread = spread + Matrix2::identity() * ROUNDING * ROUNDING;
    let mut settled: Option<(Vec<f64>, Gate)> = None;
    for step in 0..=STEPS {
        let (rows, along) = design(trace, &curve, parameters);
        let (clock, gate) = match &settled {
            Some(kept) if step > SETTLED => kept.clone(),
            _ => (clock(shares_of_time, &along), gate_of(&spread, &along)?),
        };
        let whitened = wander.whitened(&clock, &rows, &gate);
        spread = spread_of(&whitened, parameters)?;
        let inverse = spread.try_inverse()?;
        let (information, gradient) = normal_equations(&whitened, &inverse, parameters);
        if step == STEPS {
            let log_likelihood = gate_of(&spread, &along)?.log_likelihood(&whitened);
            let used = whitened.used;
            return Some(CurveFit { curve, wander, spread, information, log_likelihood, used, along, clock });
        }
        let change = -information.cholesky()?.solve(&gradient);
        curve = curve.stepped(change.as_slice());
        if !curve.point.iter().chain(&curve.bend).all(|x| x.is_finite()) {
            return None;
        }
        settled = Some((clock, gate));
    }
    None
}

/// The gate of a spread: an outlier lies anywhere across, as far as the track is long.
fn gate_of(spread: &Matrix2<f64>, along: &[f64]) -> Option<Gate> {
    let low = along.iter().copied().fold(f64::INFINITY, f64::min);
    let high = along.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let length = (high - low).max(ROUNDING);
    Gate::new(&DMatrix::from_column_slice(2, 2, spread.as_slice()), length * length)
}

/// Residuals and their slopes, one column a sample, and the lengths along the curve.
fn design(trace: &PointTrack, curve: &PathCurve, parameters: usize) -> (DMatrix<f64>, Vec<f64>) {
    let (residuals, along) = curve.residuals(&trace.position);
    let mut rows = DMatrix::zeros(2 + 2 * parameters, trace.position.len());
    rows.rows_mut(0, 2).copy_from(&residuals);
    for p in 0..parameters {
        rows.rows_mut(2 + 2 * p, 2).copy_from(&curve.slopes(&trace.position, p));
    }
    (rows, along)
}

/// Covariance of whitened residuals; `None` with too few of them.
fn spread_of(whitened: &Whitened, parameters: usize) -> Option<Matrix2<f64>> {
    let count = whitened.used.iter().filter(|u| **u).count() as f64 - 0.5 * parameters as f64;
    if count < 2.0 {
        return None;
    }
    let residuals = whitened.rows.rows(0, 2);
    let scatter = residuals * residuals.transpose() / count;
    Some(Matrix2::from_fn(|r, c| scatter[(r, c)]) + Matrix2::identity() * ROUNDING * ROUNDING)
}

/// Information of the parameters and half the gradient.
fn normal_equations(
    whitened: &Whitened,
    inverse: &Matrix2<f64>,
    parameters: usize,
) -> (DMatrix<f64>, DVector<f64>) {
    let mut information = DMatrix::zeros(parameters, parameters);
    let mut gradient = DVector::zeros(parameters);
    let residuals = inverse * whitened.rows.rows(0, 2);
    for p in 0..parameters {
        let slope = whitened.rows.rows(2 + 2 * p, 2);
        gradient[p] = slope.dot(&residuals);
        let weighed = inverse * slope;
        for q in p..parameters {
            information[(p, q)] = weighed.dot(&whitened.rows.rows(2 + 2 * q, 2));
            information[(q, p)] = information[(p, q)];
        }
    }
    (information, gradient)
}
