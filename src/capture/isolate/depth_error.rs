//! The error of depth readings with all that the noise of a small window misses.
//!
//! Errors of a stereo matcher are alike over many pixels, and those of the sensor's calibration and of camera
//! poses over whole views. Nothing moves within a state, so they show as disagreement between its views.

use rayon::prelude::*;

use crate::{NoiseConfig, RgbdFrame, window::R, window::WindowPlane};
use common::stop::{Stop, Stopped};
use numeric::statistics::{SIGMAS_PER_MAD, median};

/// Approximate number of compared windows per pair of views. chosen: as for the noise, enough for a median
const WINDOWS: f64 = 300.0;
/// Fewest compared windows for an estimate.
const LEAST_WINDOWS: usize = 200;
/// Largest disagreement, relative to the depth, of readings that may be of one surface.
/// chosen: beyond the error of any depth camera in its range; more is occlusion
const ONE_SURFACE: f64 = 0.1;

/// Standard deviation of the errors that all readings of a window share, as a multiple of the noise; 0 where
/// views have too little in common. See docs/method.md (2.9).
pub fn shared_error(states: &[Vec<RgbdFrame>], noise: &NoiseConfig, stop: &Stop) -> Result<f64, Stopped> {
    let mut pairs: Vec<[&RgbdFrame; 2]> = Vec::new();
    for frames in states {
        // Neighbors share much of the view; views further apart do not share their errors.
        for step in [1, frames.len() / 4] {
            pairs.extend(frames.iter().zip(frames.iter().skip(step.max(1))).map(|(a, b)| [a, b]));
        }
    }
    let compared: Vec<Vec<f64>> = pairs
        .par_iter()
        .map(|[a, b]| stop.check().map(|()| disagreements(a, b, noise)))
        .collect::<Result<_, Stopped>>()?;
    let all = compared.concat();
    if all.len() < LEAST_WINDOWS {
        return Ok(0.0);
    }
    // Both windows of a pair err.
    Ok(SIGMAS_PER_MAD * median(all).unwrap_or(0.0) / 2f64.sqrt())
}

/// Absolute differences in depth of the windows of one view from the planes at their places in another,
/// standard deviations of the noise.
fn disagreements(from: &RgbdFrame, to: &RgbdFrame, noise: &NoiseConfig) -> Vec<f64> {
    let k = &from.intrinsics;
    let stride = ((k.width * k.height) as f64 / WINDOWS).sqrt().ceil() as usize;
    let mut found = Vec::new();
    for y in (R..k.height.saturating_sub(R)).step_by(stride) {
        for x in (R..k.width.saturating_sub(R)).step_by(stride) {
            found.extend(disagreement(from, [x, y], to, noise));
        }
    }
    found
}

fn disagreement(from: &RgbdFrame, [x, y]: [usize; 2], to: &RgbdFrame, noise: &NoiseConfig) -> Option<f64> {
    let own = WindowPlane::fit_with_holes(from, x, y)?;
    let point = from.world_from_camera * from.intrinsics.unproject(x as f64, y as f64, 1.0 / own.inverse);
    let expected = to.in_camera(&point);
    let k = &to.intrinsics;
    let (u, v) = k.project(&expected)?;
    let margin = R as f64;
    let is_inside =
        u >= margin && v >= margin && u + margin + 1.0 < k.width as f64 && v + margin + 1.0 < k.height as f64;
    if !is_inside {
        return None;
    }
    let other = WindowPlane::fit_with_holes(to, u.round() as usize, v.round() as usize)?;
    let inverse = other.inverse + other.slopes[0] * (u - u.round()) + other.slopes[1] * (v - v.round());
    let apart_m = (1.0 / inverse - expected.z).abs();
    (apart_m < ONE_SURFACE * expected.z).then(|| apart_m / noise.sigma_m(expected.z))
}
