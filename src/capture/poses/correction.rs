//! The correction of a state's camera poses, and the decision to use it.

use std::fmt;

use nalgebra::{Vector3, Vector6};
use serde::{Deserialize, Serialize};
use tracing::debug;

use super::{
    drift::PoseErrors,
    pairs::{Gain, Views},
    pose_noise::PoseNoise,
    sensor_errors::SensorErrors,
    solve::{Problem, correction_of_pose, most_likely_poses},
};
use common::stop::Stopped;
use geometry::Pose;

/// Poses are corrected if the held-out residuals fall by this share ...
/// chosen: docs/method.md 2.7 calls it tuned, and names no recordings
const LEAST_GAIN: f64 = 0.05;
/// ... and the mean gain of the frames exceeds this many standard errors.
/// chosen: docs/method.md 2.7 calls it tuned, and names no recordings
const GAIN_SIGMAS: f64 = 4.0;
/// The correction of a state's camera poses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseCorrection {
    /// Whether it is used.
    pub used: bool,
    /// Root mean square translation of the corrections, meters.
    pub translation_rms_m: f64,
    /// Root mean square rotation of the corrections, radians.
    pub rotation_rms_rad: f64,
    /// Robust standard deviation of the held-out distances between surfaces of two frames, before and after,
    /// meters.
    pub residual_m: [f64; 2],
    /// Mean gain of the frames, in standard errors.
    pub gain_sigmas: f64,
    /// Size of independent pose errors that would give the same error of the mean.
    pub noise: PoseNoise,
    /// Estimated jitter and drift of the poses.
    pub errors: PoseErrors,
    /// Whether the poses were tracked in these frames instead of reported.
    #[serde(default)]
    pub tracked: bool,
}

impl PoseCorrection {
    /// Whether poses were corrected by more than the expected pose errors.
    #[must_use]
    pub fn beyond_expected(&self) -> bool {
        self.used && !self.tracked && self.errors.are_at_most()
    }
}

impl fmt::Display for PoseCorrection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mm = 1e3 * self.translation_rms_m;
        let deg = self.rotation_rms_rad.to_degrees();
        let [before_mm, after_mm] = self.residual_m.map(|m| 1e3 * m);
        if self.used {
            write!(
                f,
                "camera poses were corrected by {mm:.2} mm and {deg:.3} deg (root mean square); surfaces \
                 that frames share "
            )?;
            write!(f, "lay {before_mm:.2} mm apart, now {after_mm:.2} mm")
        } else {
            write!(
                f,
                "camera poses are used as reported: surfaces that frames share lie {before_mm:.2} mm apart, \
                 and a correction "
            )?;
            write!(f, "({mm:.2} mm, {deg:.3} deg) leaves {after_mm:.2} mm")
        }
    }
}

/// The corrected poses of a state.
pub(super) struct Refined {
    pub poses: Vec<Pose>,
    /// By draw, the remaining error of each frame's pose.
    pub draws: Vec<Vec<Vector6<f64>>>,
    pub correction: PoseCorrection,
}

impl Refined {
    /// Corrects the poses of one state alone, with the sensor as it is.
    pub fn of_state_alone(problem: &Problem<'_>) -> Result<Option<Self>, Stopped> {
        let Some(solution) = most_likely_poses(&[problem], None)? else { return Ok(None) };
        let draws = solution.draws.into_iter().filter_map(|d| d.poses.into_iter().next()).collect();
        let Some(poses) = solution.poses.into_iter().next() else { return Ok(None) };
        let refined = Self::new(problem, poses, draws, &solution.errors[0], None)?;
        let Some(mut refined) = refined else { return Ok(None) };
        let PoseCorrection { gain_sigmas, residual_m, .. } = refined.correction;
        // Tracked poses have no prior claim over the corrected ones.
        refined.correction.used = problem.tracked || is_clear(&Gain { sigmas: gain_sigmas, residual_m });
        Ok(Some(refined))
    }

    /// The poses that go with corrected depth; marked as used.
    pub fn new(
        problem: &Problem<'_>,
        poses: Vec<Pose>,
        draws: Vec<Vec<Vector6<f64>>>,
        errors: &PoseErrors,
        sensor: Option<&SensorErrors>,
    ) -> Result<Option<Self>, Stopped> {
        let corrected = problem.corrected_surfels(sensor);
        let after = Views { surfels: &corrected, world_from_camera: &poses };
        let changes = problem.comparison().changes_between(problem.as_reported(), after)?;
        let Some(Gain { sigmas, residual_m }) = Gain::of_changes(&[changes]) else { return Ok(None) };
        let corrections: Vec<[Vector3<f64>; 2]> =
            problem.reported.iter().zip(&poses).map(|(r, f)| correction_of_pose(r, f)).collect();
        let count = poses.len();
        let rms =
            |k: usize| (corrections.iter().map(|c| c[k].norm_squared()).sum::<f64>() / count as f64).sqrt();
        let correction = PoseCorrection {
            used: true,
            translation_rms_m: rms(0),
            rotation_rms_rad: rms(1),
            residual_m,
            gain_sigmas: sigmas,
            // As independent errors of each pose with the same error of the mean; drift increases it.
            noise: errors.of_mean(count).scaled_by((count as f64).sqrt()),
            errors: *errors,
            tracked: problem.tracked,
        };
        Ok(Some(Self { poses, draws, correction }))
    }
}

/// Whether the held-out surfels agree clearly better.
pub(super) fn is_clear(gain: &Gain) -> bool {
    is_certain(gain) && gain.residual_m[1] < (1.0 - LEAST_GAIN) * gain.residual_m[0]
}

/// Whether the held-out surfels agree better, however little.
pub(super) fn is_certain(gain: &Gain) -> bool {
    let [before_mm, after_mm] = gain.residual_m.map(|m| 1e3 * m);
    debug!(sigmas = gain.sigmas, before_mm, after_mm, "gain of held-out surfels");
    gain.sigmas > GAIN_SIGMAS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gain_may_be_certain_where_noise_hides_how_much() {
        let gain = |sigmas, residual_m| Gain { sigmas, residual_m };
        let small = gain(5.9, [1.70e-3, 1.68e-3]);
        assert!(is_certain(&small) && !is_clear(&small));
        assert!(is_clear(&gain(5.9, [1.70e-3, 1.50e-3])));
        let doubtful = gain(3.0, [1.70e-3, 1.50e-3]);
        assert!(!is_certain(&doubtful) && !is_clear(&doubtful));
    }
}
