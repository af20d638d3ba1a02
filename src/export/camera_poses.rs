//! What a report says of the camera poses.

use serde::{Deserialize, Serialize};

use super::number::round_significant;
use crate::capture::PoseCorrection;

/// Significant digits.
const DIGITS: usize = 4;

/// What was found of the camera poses of a state.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraPosesReport {
    /// State of the object.
    pub state: usize,
    /// Whether the poses were corrected; if not, the other values say what a correction would have done.
    pub corrected: bool,
    /// Root mean square length of the corrections, millimeters.
    pub correction_mm: f64,
    /// Root mean square angle of the corrections, degrees.
    pub correction_deg: f64,
    /// Robust standard deviation of the distances between surfaces that two frames see, before and after,
    /// millimeters; of readings that the correction was not fitted to.
    pub residual_mm: [f64; 2],
}

impl CameraPosesReport {
    /// Of the states where something was found.
    #[must_use]
    pub fn of(states: &[Option<PoseCorrection>]) -> Vec<Self> {
        let report = |(state, found): (usize, &Option<PoseCorrection>)| {
            let found = found.as_ref()?;
            Some(Self {
                state,
                corrected: found.used,
                correction_mm: round_significant(1e3 * found.translation_rms_m, DIGITS),
                correction_deg: round_significant(found.rotation_rms_rad.to_degrees(), DIGITS),
                residual_mm: found.residual_m.map(|m| round_significant(1e3 * m, DIGITS)),
            })
        };
        states.iter().enumerate().filter_map(report).collect()
    }
}
