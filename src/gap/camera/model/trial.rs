//! Effects visible to a camera: their parameters, priors and reports.

use nalgebra::{DMatrix, DVector};

use crate::{
    camera::{
        model::{hypothesis::Hypothesis, parameter::HypothesisParameter, scales::Scales, twin::SeenTwin},
        record::frames::FrameRun,
    },
    judge::finding::ParameterEstimate,
};
use numeric::statistics::{CHI_SQUARE_95, HALF_WIDTH_95};

/// A parameter with the standard deviation of its prior.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Column {
    /// Parameter.
    pub parameter: HypothesisParameter,
    /// One standard deviation of the prior about zero.
    pub prior: f64,
    /// Whether the prior is over the size of the errors of the twin, and so a multiple of their size.
    pub of_twin: bool,
}

impl Column {
    /// Standard deviation of the prior, for a twin with a given standard deviation of its surface.
    #[must_use]
    pub fn prior_deviation(&self, twin_m: f64) -> f64 {
        if self.of_twin { self.prior * twin_m } else { self.prior }
    }
}

/// Log odds of effects with a fit for every state.
///
/// tuned: made objects (tests/gap_frames.rs)
pub const STATEWISE: f64 = -8.0;

/// One possible action of an effect.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// Index of the effect in the catalogue.
    pub effect: usize,
    /// Name of the effect.
    pub name: &'static str,
    /// Its joint; `None` for the camera.
    pub joint: Option<usize>,
    /// Its parameters.
    pub columns: Vec<Column>,
    /// Logarithm of its odds before any frame is seen.
    pub log_odds: f64,
}

/// A trial with its values.
pub struct Fitted<'a> {
    /// Twin.
    pub twin: &'a SeenTwin,
    /// Hypothesis with the effect.
    pub hypothesis: &'a Hypothesis,
    /// The trial.
    pub trial: &'a Trial,
    /// Values of its columns.
    pub values: &'a DVector<f64>,
    /// Their covariance.
    pub covariance: &'a DMatrix<f64>,
}

impl Fitted<'_> {
    /// A linear combination of the columns with its interval.
    #[must_use]
    pub fn linear_estimate(&self, name: &str, unit: &str, weights: &DVector<f64>) -> ParameterEstimate {
        let half = HALF_WIDTH_95 * weights.dot(&(self.covariance * weights)).max(0.0).sqrt();
        let value = weights.dot(self.values);
        ParameterEstimate {
            name: name.to_owned(),
            value,
            unit: unit.to_owned(),
            interval: (value - half, value + half),
        }
    }

    /// One column with its interval.
    #[must_use]
    pub fn column_estimate(&self, name: &str, unit: &str, k: usize) -> ParameterEstimate {
        self.linear_estimate(
            name,
            unit,
            &DVector::from_fn(self.values.len(), |i, _| f64::from(u8::from(i == k))),
        )
    }

    /// Columns of turns, or the others.
    #[must_use]
    pub fn turn_columns(&self, turns: bool) -> Vec<usize> {
        let columns = self.trial.columns.iter().enumerate();
        columns.filter(|(_, c)| c.parameter.is_turn() == turns).map(|(k, _)| k).collect()
    }

    /// Length of a vector of columns with its interval.
    #[must_use]
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
        // A vector with zero in its interval has no least length.
        let squares = own.cholesky().map_or(0.0, |c| vector.dot(&c.solve(&vector)));
        let zero = squares < CHI_SQUARE_95[columns.len().min(CHI_SQUARE_95.len()) - 1];
        estimate.interval.0 = if zero { 0.0 } else { estimate.interval.0.max(0.0) };
        estimate
    }
}

/// An effect visible to a camera. One file in `effects/` each, with every fact about it.
pub struct CameraEffect {
    /// Name in reports.
    pub name: &'static str,
    /// Its possible actions on a twin and its recordings: joint and columns.
    pub trials: fn(&SeenTwin, &[FrameRun], &Scales) -> Vec<(Option<usize>, Vec<Column>)>,
    /// Logarithm of its odds before any frame is seen: 0 but for effects with a fit for every state, as these
    /// must explain more than a law for all states.
    pub log_odds: f64,
    /// Parameters as a report names them.
    pub reported: fn(&Fitted) -> Vec<ParameterEstimate>,
    /// The types of the joint in the twin and in the frames, for a change of type.
    pub types: Option<[&'static str; 2]>,
    /// Its form in a URDF.
    pub in_urdf: &'static str,
    /// The recording to distinguish it from similar effects.
    pub experiment: &'static str,
}

/// A column.
#[must_use]
pub fn prior_column(parameter: HypothesisParameter, prior: f64) -> Column {
    Column { parameter, prior, of_twin: false }
}

/// A column of an error without name, as large as those of the twin's surface.
#[must_use]
pub fn twin_column(parameter: HypothesisParameter, share: f64) -> Column {
    Column { parameter, prior: share, of_twin: true }
}

/// Joints with a motion of their own.
pub fn free_joints(twin: &SeenTwin) -> impl Iterator<Item = usize> + '_ {
    (0..twin.joints.len()).filter(|&j| twin.joints[j].mimic.is_none())
}
