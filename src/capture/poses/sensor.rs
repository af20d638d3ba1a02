//! Calibration of a sensor's systematic errors, jointly with the poses of all states.

use std::fmt;

use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    correction::{Refined, is_certain, is_clear},
    depth_warp::DepthWarp,
    pairs::{Changes, Gain, Views},
    sensor_errors::SensorErrors,
    solve::{Problem, Sensor, Solution, most_likely_poses},
};
use crate::{RgbdFrame, frame::cameras};
use common::stop::Stopped;
use geometry::{Intrinsics, bilinear};

/// The calibration of the depth sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorCalibration {
    /// Whether depth was corrected by it.
    pub used: bool,
    /// Depth error per pixel, share of the range.
    pub warp: DepthWarp,
    /// Covariance of the warp's coefficients, row by row.
    pub covariance: Vec<f64>,
    /// Mean depth error over the image and its standard deviation, shares of the range; positive where
    /// readings are too short.
    pub scale: [f64; 2],
    /// Root mean square deviation of the error from this mean.
    pub warp_rms: f64,
    /// Along each image axis: offset of color against depth, and its standard deviation, pixels.
    pub color_shift_px: [[f64; 2]; 2],
    /// Delay of the reported poses against the images, and its standard deviation, seconds.
    pub pose_lag_s: [f64; 2],
    /// Robust standard deviation of held-out distances between surfaces of two frames, meters: with corrected
    /// poses alone, and with corrected depth too.
    pub residual_m: [f64; 2],
    /// Mean gain of the frames, in standard errors.
    pub gain_sigmas: f64,
}

/// Least reported delay of poses, seconds: one image at 30 a second, as synchronized clocks leave
/// milliseconds.
/// chosen: a delay that any pose shows
const LATE_S: f64 = 1.0 / 30.0;
/// Depth accuracy in data sheets, share of the range.
/// derived: accuracy at 2 m in data sheets of Intel's D400 family
const DATA_SHEET: f64 = 0.02;

impl SensorCalibration {
    /// Whether the depth error exceeds the data sheets'.
    #[must_use]
    pub fn beyond_data_sheets(&self) -> bool {
        self.used && self.scale[0].abs().max(self.warp_rms) > DATA_SHEET
    }

    /// Whether poses are delayed by more than synchronized clocks explain.
    #[must_use]
    pub fn has_late_poses(&self) -> bool {
        let [lag_s, sigma_s] = self.pose_lag_s;
        self.used && lag_s.abs() > LATE_S && lag_s.abs() > 3.0 * sigma_s
    }

    /// The errors to be corrected.
    pub(super) fn sensor_errors(&self, intrinsics: &Intrinsics) -> SensorErrors {
        let [u, v] = self.color_shift_px[0];
        SensorErrors {
            warp: self.warp.clone(),
            color_shift: [u / intrinsics.fx, v / intrinsics.fy],
            lag_s: self.pose_lag_s[0],
        }
    }

    /// Shifts the color of frames into alignment with depth.
    pub(super) fn move_color<'a>(&self, frames: impl Iterator<Item = &'a mut RgbdFrame>) {
        let [du, dv] = self.color_shift_px[0];
        for frame in frames {
            let width = frame.intrinsics.width;
            let height = frame.intrinsics.height;
            let pixels = (0..width * height).into_par_iter();
            let color = |i: usize| Vector3::from(frame.rgb[i].map(f64::from));
            let moved = pixels
                .map(|i| bilinear(color, width, height, (i % width) as f64 + du, (i / width) as f64 + dv));
            frame.rgb = moved.map(|color| color.map(|level| level.round() as u8).into()).collect();
        }
    }

    /// Standard deviations of the warp's coefficients.
    #[must_use]
    pub fn warp_sigmas(&self) -> Vec<f64> {
        let count = self.warp.values.len();
        self.covariance.iter().step_by(count + 1).map(|variance| variance.sqrt()).collect()
    }
}

impl fmt::Display for SensorCalibration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [scale, sigma] = self.scale.map(|s| 100.0 * s);
        let warp = 100.0 * self.warp_rms;
        let [u, v] = self.color_shift_px[0].map(|c| -c);
        let [lag_ms, lag_sigma_ms] = self.pose_lag_s.map(|s| 1e3 * s);
        let [before_mm, after_mm] = self.residual_m.map(|m| 1e3 * m);
        if self.used {
            write!(
                f,
                "depth was corrected by {scale:+.2} % (standard deviation {sigma:.2} %) and by a smooth warp \
                 of {warp:.2} % over the image (root mean square), color was moved by {u:.1} and {v:.1} \
                 pixels against depth, and poses by {lag_ms:.1} ms (standard deviation {lag_sigma_ms:.1} \
                 ms), found with the camera poses; surfaces that frames share lay \
                 {before_mm:.2} mm apart by poses alone, now {after_mm:.2} mm"
            )
        } else {
            write!(
                f,
                "depth is used as read: by poses alone surfaces that frames share lie {before_mm:.2} mm \
                 apart, and a corrected sensor leaves {after_mm:.2} mm"
            )
        }
    }
}

/// Results of the joint calibration.
pub(super) struct Calibrated {
    pub calibration: SensorCalibration,
    /// The poses of each state.
    pub states: Vec<Option<Refined>>,
    /// Draws of the remaining depth error.
    pub warps: Vec<DepthWarp>,
}

/// Solves for the poses of all states jointly with the sensor's errors; `None` without states to correct, or
/// if they have several cameras.
pub(super) fn solve_together(
    states: &[Vec<RgbdFrame>],
    problems: &[Option<Problem<'_>>],
) -> Result<Option<Solution>, Stopped> {
    let [intrinsics] = cameras(states.iter().flatten())[..] else { return Ok(None) };
    let posed: Vec<&Problem<'_>> = problems.iter().flatten().collect();
    if posed.is_empty() {
        Ok(None)
    } else {
        most_likely_poses(&posed, Some(SensorErrors::without_errors(&intrinsics)))
    }
}

/// The sensor's errors with the poses of all states; `None` for several cameras, or where too little is seen.
pub(super) fn calibrated_sensor(
    states: &[Vec<RgbdFrame>],
    problems: &[Option<Problem<'_>>],
    alone: &[Option<Refined>],
    Solution { poses, errors, sensor, draws }: Solution,
) -> Result<Option<Calibrated>, Stopped> {
    let [intrinsics] = cameras(states.iter().flatten())[..] else { return Ok(None) };
    let Some(Sensor { errors: sensor, covariance }) = sensor else { return Ok(None) };
    let mut found = poses.into_iter().zip(&errors).enumerate();
    let refined: Vec<Option<Refined>> = problems
        .iter()
        .map(|problem| {
            let Some(problem) = problem else { return Ok(None) };
            let Some((k, (poses, errors))) = found.next() else { return Ok(None) };
            let draws = draws.iter().map(|d| d.poses[k].clone()).collect();
            Refined::new(problem, poses, draws, errors, Some(&sensor))
        })
        .collect::<Result<_, Stopped>>()?;
    // Relative to the best poses alone.
    let changes: Vec<Changes> = problems
        .par_iter()
        .zip(alone)
        .zip(&refined)
        .filter_map(|((problem, alone), refined)| {
            let problem = problem.as_ref()?;
            let refined = refined.as_ref()?;
            let corrected = problem.corrected_surfels(Some(&sensor));
            let best = alone.as_ref().filter(|a| a.correction.used).map_or(&problem.reported, |a| &a.poses);
            let before = Views { surfels: problem.surfels, world_from_camera: best };
            let after = Views { surfels: &corrected, world_from_camera: &refined.poses };
            Some(problem.comparison().changes_between(before, after))
        })
        .collect::<Result<_, Stopped>>()?;
    // All frames of all states decide together, since they share the sensor.
    let Some(gain) = Gain::of_changes(&changes) else { return Ok(None) };
    let count = sensor.first_of_shift();
    let focal_px = [intrinsics.fx, intrinsics.fy];
    let lag = sensor.lag_index();
    let pose_lag_s = [sensor.lag_s, covariance[(lag, lag)].sqrt()];
    let color_shift_px = [
        [0, 1].map(|i| sensor.color_shift[i] * focal_px[i]),
        [0, 1].map(|i| covariance[(count + i, count + i)].sqrt() * focal_px[i]),
    ];
    let covariance = covariance.view((0, 0), (count, count)).into_owned();
    let mut warps = Vec::with_capacity(draws.len());
    for draw in &draws {
        let values = draw.sensor.rows(0, count).iter().copied().collect();
        warps.push(DepthWarp { values, ..sensor.warp.clone() });
    }
    let warp = sensor.warp;
    let mean = warp.mean_weights(&intrinsics);
    // A sensor that errs bends the poses. Beside their errors, the noise of depth may hide by how much the
    // sensor's own make surfaces differ.
    let are_bent = alone.iter().flatten().any(|a| a.correction.used);
    let calibration = SensorCalibration {
        used: if are_bent { is_certain(&gain) } else { is_clear(&gain) },
        scale: [
            mean.iter().zip(&warp.values).map(|(share, v)| share * v).sum(),
            mean.dot(&(&covariance * &mean)).sqrt(),
        ],
        warp_rms: warp.spread_about_mean(&intrinsics),
        color_shift_px,
        pose_lag_s,
        covariance: covariance.as_slice().to_vec(),
        warp,
        residual_m: gain.residual_m,
        gain_sigmas: gain.sigmas,
    };
    Ok(Some(Calibrated { calibration, states: refined, warps }))
}
