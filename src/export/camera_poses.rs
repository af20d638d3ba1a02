//! Camera poses and depth sensor in a report.

use serde::{Deserialize, Serialize};

use super::number::round_significant;
use capture::{PoseCorrection, SensorCalibration, TrackingFindings};

/// Significant digits.
const DIGITS: usize = 4;

/// Corrections of the camera poses of a state.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraPosesReport {
    /// State of the object.
    pub state: usize,
    /// Whether the poses were corrected; if not, the other values are of the unused correction.
    pub corrected: bool,
    /// Root mean square length of the corrections, millimeters.
    pub correction_mm: f64,
    /// Root mean square angle of the corrections, degrees.
    pub correction_deg: f64,
    /// Robust standard deviation of the distances between surfaces in two frames, before and after,
    /// millimeters; of readings held out from the fit.
    pub residual_mm: [f64; 2],
}

impl CameraPosesReport {
    /// Reports of the states with a correction.
    #[must_use]
    pub fn of_corrections(states: &[Option<PoseCorrection>]) -> Vec<Self> {
        let mut reports = Vec::new();
        for (state, found) in states.iter().enumerate() {
            let Some(found) = found else { continue };
            reports.push(Self {
                state,
                corrected: found.used,
                correction_mm: round_significant(1e3 * found.translation_rms_m, DIGITS),
                correction_deg: round_significant(found.rotation_rms_rad.to_degrees(), DIGITS),
                residual_mm: found.residual_m.map(|m| round_significant(1e3 * m, DIGITS)),
            });
        }
        reports
    }
}

/// How the camera was tracked through a state of a recording without poses.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraTrackingReport {
    /// State of the object.
    pub state: usize,
    /// Views of the state.
    pub views: usize,
    /// Views with a found pose.
    pub tracked: usize,
    /// First and last view of each stretch without tracking, by their numbers from 0.
    pub lost: Vec<[usize; 2]>,
    /// Views with a part in placing the others.
    pub keyframes: usize,
    /// Pairs of keyframes of the same place at different times, beside those on the way.
    pub loops: usize,
    /// By how much closing loops moved keyframes, root mean square, millimeters.
    pub closed_mm: f64,
    /// Standard deviation of a keyframe's place against its neighbors in the least known direction, median,
    /// millimeters.
    pub least_known_mm: f64,
}

impl CameraTrackingReport {
    /// Reports of all states; none for recorded poses.
    #[must_use]
    pub fn of_findings(states: &[TrackingFindings]) -> Vec<Self> {
        states.iter().enumerate().map(|(state, found)| Self::of_state(state, found)).collect()
    }

    fn of_state(state: usize, found: &TrackingFindings) -> Self {
        Self {
            state,
            views: found.views,
            tracked: found.tracked,
            lost: found.lost.clone(),
            keyframes: found.keyframes,
            loops: found.pairs[1],
            closed_mm: round_significant(1e3 * found.closed_m, DIGITS),
            least_known_mm: round_significant(1e3 * found.least_known_m, DIGITS),
        }
    }
}

/// Uncertainty of the twin's frame as a whole, left out of joints and surfaces: the world of a camera's poses
/// exists in these alone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WorldFrameReport {
    /// Root mean square displacement of the middle of the root link, millimeters.
    pub std_mm: f64,
    /// Root mean square turn, degrees.
    pub std_deg: f64,
}

impl WorldFrameReport {
    /// The report of a displacement, meters, and a turn, radians.
    #[must_use]
    pub fn of_uncertainty([moved_m, turned_rad]: [f64; 2]) -> Self {
        Self {
            std_mm: round_significant(1e3 * moved_m, DIGITS),
            std_deg: round_significant(turned_rad.to_degrees(), DIGITS),
        }
    }
}

/// Errors of the depth sensor: true depth is a reading times 1 + scale + warp.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DepthSensorReport {
    /// Whether depth was corrected; if not, the other values are of the unused correction.
    pub corrected: bool,
    /// Mean correction over the image and its standard deviation, percent of the range.
    pub scale_percent: [f64; 2],
    /// Deviation from it over the image, root mean square, percent of the range.
    pub warp_percent: f64,
    /// Offset of the color image against the depth image, pixels; color was moved back.
    pub color_shift_px: [f64; 2],
    /// Their standard deviations.
    pub color_shift_std_px: [f64; 2],
    /// By how much the reported poses are older than the images, and its standard deviation, milliseconds;
    /// corrected.
    pub pose_lag_ms: [f64; 2],
    /// Robust standard deviation of the distances between surfaces in two frames, with corrected poses alone
    /// and with corrected depth, millimeters; of readings held out from the fit.
    pub residual_mm: [f64; 2],
    /// Pixels from one value of the cubic B-spline to the next; the first lies one step outside the image.
    pub step_px: f64,
    /// Values in a row, and rows.
    pub shape: [usize; 2],
    /// Scale and warp together, row by row, percent of the range.
    pub values_percent: Vec<f64>,
    /// Their standard deviations.
    pub sigmas_percent: Vec<f64>,
}

impl DepthSensorReport {
    /// The report of a calibration.
    #[must_use]
    pub fn of_calibration(found: &SensorCalibration) -> Self {
        let percent = |share: f64| round_significant(100.0 * share, DIGITS);
        Self {
            corrected: found.used,
            scale_percent: found.scale.map(percent),
            warp_percent: percent(found.warp_rms),
            color_shift_px: found.color_shift_px[0].map(|c| round_significant(c, DIGITS)),
            color_shift_std_px: found.color_shift_px[1].map(|c| round_significant(c, DIGITS)),
            pose_lag_ms: found.pose_lag_s.map(|s| round_significant(1e3 * s, DIGITS)),
            residual_mm: found.residual_m.map(|m| round_significant(1e3 * m, DIGITS)),
            step_px: found.warp.step_px,
            shape: found.warp.shape,
            values_percent: found.warp.values.iter().copied().map(percent).collect(),
            sigmas_percent: found.warp_sigmas().into_iter().map(percent).collect(),
        }
    }
}
