//! The depth sensor's own errors, found together with the poses of all states that it recorded.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::{
    correction::{Refined, is_clear},
    depth_warp::DepthWarp,
    pairs::{Changes, Gain, Views},
    solve::{Problem, Sensor, Solution, solve},
};
use crate::{capture::RgbdFrame, geometry::Intrinsics};

/// What was found of the depth sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorCalibration {
    /// Whether depth is corrected by it.
    pub used: bool,
    /// The error of every pixel, as a share of the range.
    pub warp: DepthWarp,
    /// Covariance of the warp's values, row by row.
    pub covariance: Vec<f64>,
    /// Mean of the error over the image, and its standard deviation: readings are too short by this share.
    pub scale: [f64; 2],
    /// What differs from it, root mean square over the image.
    pub warp_rms: f64,
    /// Robust standard deviation of the distances between surfaces that two frames see, held out, by
    /// corrected poses alone and with corrected depth, meters.
    pub residual_m: [f64; 2],
    /// Mean gain of the frames in its standard errors.
    pub gain_sigmas: f64,
}

/// Data sheets of depth cameras allow this share of the range.
const DATA_SHEET: f64 = 0.02;

impl SensorCalibration {
    /// Whether the sensor errs by more than data sheets allow.
    #[must_use]
    pub fn beyond_data_sheets(&self) -> bool {
        self.used && self.scale[0].abs().max(self.warp_rms) > DATA_SHEET
    }

    /// Standard deviations of the warp's values.
    #[must_use]
    pub fn sigmas(&self) -> Vec<f64> {
        let count = self.warp.values.len();
        self.covariance.iter().step_by(count + 1).map(|variance| variance.sqrt()).collect()
    }
}

impl fmt::Display for SensorCalibration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [scale, sigma] = self.scale.map(|s| 100.0 * s);
        let warp = 100.0 * self.warp_rms;
        let [before_mm, after_mm] = self.residual_m.map(|m| 1e3 * m);
        if self.used {
            write!(
                f,
                "depth was corrected by {scale:+.2} % (standard deviation {sigma:.2} %) and by a smooth warp \
                 of {warp:.2} % over the image (root mean square), found with the camera poses; surfaces \
                 that frames share lay {before_mm:.2} mm apart by poses alone, now {after_mm:.2} mm"
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

/// The sensor's errors, with the poses of all states that go with them; `None` where the states have not one
/// camera, or too little is seen.
pub(super) fn calibrate(
    states: &[Vec<RgbdFrame>],
    problems: &[Option<Problem<'_>>],
    alone: &[Option<Refined>],
) -> Option<(Vec<Option<Refined>>, SensorCalibration)> {
    let intrinsics = one_camera(states)?;
    let posed: Vec<&Problem<'_>> = problems.iter().flatten().collect();
    if posed.is_empty() {
        return None;
    }
    let Solution { poses, errors, sensor } = solve(&posed, Some(DepthWarp::none(&intrinsics)))?;
    let Sensor { warp, covariance } = sensor?;
    let mut found = poses.into_iter().zip(&errors);
    let refined: Vec<Option<Refined>> = problems
        .iter()
        .map(|problem| {
            let problem = problem.as_ref()?;
            let (poses, errors) = found.next()?;
            Refined::new(problem, poses, errors, Some(&warp))
        })
        .collect();
    // Against the best that poses alone can do.
    let changes: Vec<Changes> = problems
        .iter()
        .zip(alone)
        .zip(&refined)
        .filter_map(|((problem, alone), refined)| {
            let (problem, refined) = (problem.as_ref()?, refined.as_ref()?);
            let corrected = problem.corrected(Some(&warp));
            let best = alone.as_ref().filter(|a| a.correction.used).map_or(&problem.reported, |a| &a.poses);
            let before = Views { surfels: problem.surfels, world_from_camera: best };
            let after = Views { surfels: &corrected, world_from_camera: &refined.poses };
            Some(problem.comparison().changes(before, after))
        })
        .collect();
    // All frames of all states decide together, since they have one sensor.
    let gain = Gain::of(&changes)?;
    let mean = warp.mean(&intrinsics);
    let calibration = SensorCalibration {
        used: is_clear(&gain),
        scale: [
            mean.iter().zip(&warp.values).map(|(share, v)| share * v).sum(),
            mean.dot(&(&covariance * &mean)).sqrt(),
        ],
        warp_rms: warp.spread(&intrinsics),
        covariance: covariance.as_slice().to_vec(),
        warp,
        residual_m: gain.residual_m,
        gain_sigmas: gain.sigmas,
    };
    Some((refined, calibration))
}

/// The camera of all frames; `None` where they have several.
fn one_camera(states: &[Vec<RgbdFrame>]) -> Option<Intrinsics> {
    let mut all = states.iter().flatten().map(|f| f.intrinsics);
    let first = all.next()?;
    all.all(|other| other == first).then_some(first)
}
