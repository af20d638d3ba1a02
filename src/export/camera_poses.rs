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
    /// Whether the poses were corrected; if not, the other values are of a correction that was not used.
    pub corrected: bool,
    /// Root mean square length of the corrections, millimeters.
    pub correction_mm: f64,
    /// Root mean square angle of the corrections, degrees.
    pub correction_deg: f64,
    /// Robust standard deviation of the distances between surfaces in two frames, before and after
    /// correction, millimeters; from readings held out of the fit.
    pub residual_mm: [f64; 2],
}

impl CameraPosesReport {
    /// Reports of the states with a correction.
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
    /// Number of views of the state.
    pub views: usize,
    /// Number of views whose pose was found.
    pub tracked: usize,
    /// First and last view, numbered from 0, of each stretch in which tracking was lost.
    pub lost: Vec<[usize; 2]>,
    /// Number of views against which the others were placed.
    pub keyframes: usize,
    /// Number of keyframe pairs that show one place at different times, beside consecutive ones.
    pub loops: usize,
    /// How far loop closure moved the keyframes, root mean square, millimeters.
    pub closed_mm: f64,
    /// Standard deviation of a keyframe's place relative to its neighbors in the least known direction; the
    /// median over keyframes, millimeters.
    pub least_known_mm: f64,
}

impl CameraTrackingReport {
    /// Reports of all states; empty for recorded poses.
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

/// Uncertainty of the twin's frame as a whole, not included in joints and surfaces: the camera poses alone
/// define the world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WorldFrameReport {
    /// Root mean square displacement of the center of the root link, millimeters.
    pub std_mm: f64,
    /// Root mean square rotation, degrees.
    pub std_deg: f64,
}

impl WorldFrameReport {
    /// The report of a displacement, meters, and a rotation, radians.
    pub fn of_uncertainty([moved_m, turned_rad]: [f64; 2]) -> Self {
        Self {
            std_mm: round_significant(1e3 * moved_m, DIGITS),
            std_deg: round_significant(turned_rad.to_degrees(), DIGITS),
        }
    }
}

/// Errors of the depth sensor: true depth is a reading times (1 + scale + warp).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DepthSensorReport {
    /// Whether depth was corrected; if not, the other values are of a correction that was not used.
    pub corrected: bool,
    /// Mean correction over the image and its standard deviation, percent of the range.
    pub scale_percent: [f64; 2],
    /// Deviation from it over the image, root mean square, percent of the range.
    pub warp_percent: f64,
    /// Offset of the color image relative to the depth image, pixels; it was corrected.
    pub color_shift_px: [f64; 2],
    /// Their standard deviations.
    pub color_shift_std_px: [f64; 2],
    /// How much older the reported poses are than the images, and the standard deviation, milliseconds; it
    /// was corrected.
    pub pose_lag_ms: [f64; 2],
    /// Robust standard deviation of the distances between surfaces in two frames, with only the poses
    /// corrected and with the depth corrected too, millimeters; from readings held out of the fit.
    pub residual_mm: [f64; 2],
    /// Distance of neighboring coefficients of the cubic B-spline, pixels; the first is one step outside the
    /// image.
    pub step_px: f64,
    /// Coefficients in a row, and number of rows.
    pub shape: [usize; 2],
    /// Sum of scale and warp, row by row, percent of the range.
    pub values_percent: Vec<f64>,
    /// Their standard deviations.
    pub sigmas_percent: Vec<f64>,
}

impl DepthSensorReport {
    /// The report of a calibration.
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
