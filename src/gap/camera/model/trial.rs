//! Effects visible to a camera: parameters, priors and reports.

use nalgebra::{DMatrix, DVector};

use crate::{
    camera::{
        model::{hypothesis::Hypothesis, parameter::HypothesisParameter, scales::Scales, twin::SeenTwin},
        record::frames::FrameRun,
    },
    judge::finding::ParameterEstimate,
};
use numeric::statistics::{CHI_SQUARE_95, HALF_WIDTH_95};

/// A free parameter and its prior.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Column {
    /// Parameter.
    pub parameter: HypothesisParameter,
    /// Standard deviation of the prior, which has mean zero.
    pub prior: f64,
    /// Whether `prior` is a multiple of the twin's surface error instead of an absolute size.
    pub of_twin: bool,
}

impl Column {
    /// Standard deviation of the prior for a twin with surface error `twin_m`, meters.
    pub fn prior_deviation(&self, twin_m: f64) -> f64 {
        if self.of_twin { self.prior * twin_m } else { self.prior }
    }
}

/// Log prior odds of effects with a separate fit for every state.
///
/// tuned: made objects (tests/gap_frames.rs)
pub const STATEWISE: f64 = -8.0;

/// One way an effect may act.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// Index of the effect in the catalogue.
    pub effect: usize,
    /// Name of the effect.
    pub name: &'static str,
    /// The joint concerned; `None` for the camera.
    pub joint: Option<usize>,
    /// Its parameters.
    pub columns: Vec<Column>,
    /// Logarithm of its prior odds.
    pub log_odds: f64,
}

/// A trial with its fitted values.
pub struct Fitted<'a> {
    /// Twin.
    pub twin: &'a SeenTwin,
    /// Hypothesis including the effect.
    pub hypothesis: &'a Hypothesis,
    /// The trial.
    pub trial: &'a Trial,
    /// Values of its columns.
    pub values: &'a DVector<f64>,
    /// Their covariance.
    pub covariance: &'a DMatrix<f64>,
}

impl Fitted<'_> {
    /// A linear combination of the columns, with its 95 % interval.
    pub fn linear_estimate(&self, name: &str, unit: &str, weights: &DVector<f64>) -> ParameterEstimate {
        let half = HALF_WIDTH_95 * weights.dot(&(self.covariance * weights)).max(0.0).sqrt();
        let value = weights.dot(self.values);
        ParameterEstimate::with_half_width(name, value, unit, half)
    }

    /// One column with its 95 % interval.
    pub fn column_estimate(&self, name: &str, unit: &str, k: usize) -> ParameterEstimate {
        self.linear_estimate(
            name,
            unit,
            &DVector::from_fn(self.values.len(), |i, _| f64::from(u8::from(i == k))),
        )
    }

    /// Indices of the columns of turns (`turns`) or of all others.
    pub fn turn_columns(&self, turns: bool) -> Vec<usize> {
        let columns = self.trial.columns.iter().enumerate();
        columns.filter(|(_, c)| c.parameter.is_turn() == turns).map(|(k, _)| k).collect()
    }

    /// Length of the vector formed by some columns, with its 95 % interval.
    pub fn length_estimate(&self, name: &str, unit: &str, columns: &[usize]) -> ParameterEstimate {
        let norm = columns.iter().map(|&k| self.values[k].powi(2)).sum::<f64>().sqrt();
        let mut weights = DVector::zeros(self.values.len());
        for &k in columns {
            weights[k] = self.values[k] / norm.max(1e-12);
        }
        let mut estimate = self.linear_estimate(name, unit, &weights);
        let own =
            DMatrix::from_fn(columns.len(), columns.len(), |i, j| self.covariance[(columns[i], columns[j])]);
        let vector = DVector::from_fn(columns.len(), |i, _| self.values[columns[i]]);
        // If the interval contains the zero vector, the length has the lower bound 0.
        let squares = own.cholesky().map_or(0.0, |c| vector.dot(&c.solve(&vector)));
        let zero = squares < CHI_SQUARE_95[columns.len().min(CHI_SQUARE_95.len()) - 1];
        estimate.interval.0 = if zero { 0.0 } else { estimate.interval.0.max(0.0) };
        estimate
    }
}

/// An effect visible to a camera. Each has one file in `effects/`, holding every fact about it.
pub struct CameraEffect {
    /// Name in reports.
    pub name: &'static str,
    /// Ways it may act on a twin and its recordings: joint and columns of each.
    pub trials: fn(&SeenTwin, &[FrameRun], &Scales) -> Vec<(Option<usize>, Vec<Column>)>,
    /// Logarithm of its prior odds: 0, or negative for effects with a separate fit for every state, which
    /// must explain more than a law common to all states.
    pub log_odds: f64,
    /// Its parameters as named in reports.
    pub reported: fn(&Fitted) -> Vec<ParameterEstimate>,
    /// Joint type in the twin and in the frames, for a change of type.
    pub types: Option<[&'static str; 2]>,
    /// How a URDF expresses it.
    pub in_urdf: &'static str,
    /// The recording to distinguish it from similar effects.
    pub experiment: &'static str,
}

/// A column with an absolute prior.
pub fn prior_column(parameter: HypothesisParameter, prior: f64) -> Column {
    Column { parameter, prior, of_twin: false }
}

/// A column of an unnamed error, with a prior relative to the twin's surface error.
pub fn twin_column(parameter: HypothesisParameter, share: f64) -> Column {
    Column { parameter, prior: share, of_twin: true }
}

/// Joints moving independently: all but mimic joints.
pub fn free_joints(twin: &SeenTwin) -> impl Iterator<Item = usize> + '_ {
    (0..twin.joints.len()).filter(|&j| twin.joints[j].mimic.is_none())
}
