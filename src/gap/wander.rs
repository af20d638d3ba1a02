//! What a model leaves along a track or a run: a process that wanders, with a white part and outliers.
//!
//! The wandering part is an Ornstein-Uhlenbeck process, the roughest of the usual ones: it does not take the
//! smoothness of a recording for precision. A Kalman filter turns it into independent innovations; the filter
//! is linear, so residuals and slopes pass through the same one (as in docs/method.md 14.10).

use nalgebra::{DMatrix, DVector};

/// Lengths over which the wandering part is correlated, as shares of the track.
/// chosen: from a few samples to more than the whole track, each about twice the one before.
const LENGTHS: [f64; 8] = [0.02, 0.05, 0.1, 0.2, 0.4, 0.9, 2.0, 4.0];
/// Shares of the white part in the variance.
/// chosen: from nearly none to all.
const WHITES: [f64; 7] = [3e-4, 3e-3, 0.03, 0.1, 0.3, 0.6, 1.0];
/// Share of the clock that is time; the rest is way.
/// measured: shared/doors/tracks, where the half is more likely than either alone.
const TIME_SHARE: f64 = 0.5;
/// Share of samples that are expected to be outliers.
/// chosen: a tracker that is wrong more often is seen by eye.
pub const OUTLIERS: f64 = 0.01;

/// Correlation of what lies off a curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wander {
    /// Length over which it is correlated, as a share of the track.
    pub length: f64,
    /// Share of the white part in the variance.
    pub white: f64,
}

impl Wander {
    /// All that are tried.
    pub fn all() -> impl Iterator<Item = Self> {
        WHITES.into_iter().flat_map(|white| {
            // Without a wandering part its length has no effect.
            let count = if white < 1.0 { LENGTHS.len() } else { 1 };
            LENGTHS.into_iter().take(count).map(move |length| Self { length, white })
        })
    }

    /// Correlation of the errors at two places of the clock.
    #[must_use]
    pub fn correlation(&self, apart: f64) -> f64 {
        (1.0 - self.white) * (-apart.abs() / self.length).exp()
    }

    /// Innovations of rows, one column a sample, the first `channels` of which are residuals, by the clock of
    /// the samples. A sample that the gate refuses has zeros and changes nothing.
    #[must_use]
    pub fn whitened(&self, clock: &[f64], rows: &DMatrix<f64>, gate: &Gate) -> Whitened {
        let wandering = 1.0 - self.white;
        let mut out = DMatrix::zeros(rows.nrows(), rows.ncols());
        let mut used = vec![false; clock.len()];
        let mut log_det = 0.0;
        let mut mean = DVector::zeros(rows.nrows());
        let mut variance = wandering;
        for k in 0..clock.len() {
            if k > 0 {
                let kept = (-(clock[k] - clock[k - 1]).max(0.0) / self.length).exp();
                mean *= kept;
                variance = kept * kept * variance + (1.0 - kept * kept) * wandering;
            }
            let expected = variance + self.white;
            let innovation = rows.column(k) - &mean;
            if !gate.admits(&innovation, expected) {
                continue;
            }
            used[k] = true;
            log_det += expected.ln();
            out.set_column(k, &(&innovation / expected.sqrt()));
            let gain = variance / expected;
            mean += innovation * gain;
            variance *= 1.0 - gain;
        }
        Whitened { rows: out, used, log_det }
    }
}

/// Innovations of unit variance, in units of the spread.
#[derive(Clone, Debug)]
pub struct Whitened {
    /// Innovations, one column a sample.
    pub rows: DMatrix<f64>,
    /// Which samples are no outliers.
    pub used: Vec<bool>,
    /// Sum of the logarithms of the variances of the innovations of a channel.
    pub log_det: f64,
}

/// What counts as an outlier: a sample that is more likely to lie anywhere than where the process expects it.
#[derive(Clone, Debug)]
pub struct Gate {
    /// Inverse of the covariance of the channels.
    inverse: DMatrix<f64>,
    /// Logarithm of the density of an inlier without its misfit.
    inlier: f64,
    /// Logarithm of the density of an outlier.
    pub outlier: f64,
}

impl Gate {
    /// The gate of a spread, where an outlier lies anywhere in a volume of the channels' units.
    #[must_use]
    pub fn new(spread: &DMatrix<f64>, volume: f64) -> Option<Self> {
        let factor = spread.clone().cholesky()?;
        let channels = spread.nrows() as f64;
        let inlier =
            (1.0 - OUTLIERS).ln() - 0.5 * (factor.determinant().ln() + channels * std::f64::consts::TAU.ln());
        Some(Self { inverse: factor.inverse(), inlier, outlier: (OUTLIERS / volume).ln() })
    }

    /// A gate of one channel that nothing counts as an outlier for.
    #[must_use]
    pub fn open() -> Self {
        Self { inverse: DMatrix::identity(1, 1), inlier: 0.0, outlier: f64::NEG_INFINITY }
    }

    fn admits(&self, innovation: &DVector<f64>, expected: f64) -> bool {
        let channels = self.inverse.nrows();
        let off = innovation.rows(0, channels);
        let misfit = off.dot(&(&self.inverse * off)) / expected;
        self.inlier - 0.5 * (misfit + channels as f64 * expected.ln()) > self.outlier
    }

    /// Log likelihood of whitened residuals at the spread that they have, with the outliers.
    #[must_use]
    pub fn log_likelihood(&self, whitened: &Whitened) -> f64 {
        let channels = self.inverse.nrows();
        let inliers = whitened.used.iter().filter(|u| **u).count();
        let residuals = whitened.rows.rows(0, channels);
        let misfit = (&self.inverse * residuals * residuals.transpose()).trace();
        self.inlier * inliers as f64 + self.outlier * (whitened.used.len() - inliers) as f64
            - 0.5 * (misfit + channels as f64 * whitened.log_det)
    }
}

/// The clock of a track, from 0 to 1: partly its time, partly its way. A hand that rests does not slip, and
/// a tracker errs anew on the way back.
#[must_use]
pub fn clock(shares_of_time: &[f64], along: &[f64]) -> Vec<f64> {
    let mut way = vec![0.0; along.len()];
    for k in 1..along.len() {
        way[k] = way[k - 1] + (along[k] - along[k - 1]).abs();
    }
    let whole = way.last().copied().filter(|w| *w > 0.0).unwrap_or(1.0);
    shares_of_time.iter().zip(&way).map(|(t, w)| TIME_SHARE * t + (1.0 - TIME_SHARE) * w / whole).collect()
}
