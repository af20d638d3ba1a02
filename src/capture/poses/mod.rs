//! Errors of the camera poses within a state, found by what its frames see of the same surfaces.
//!
//! All poses of a state are solved for together: distances between small flat pieces of surface in one frame and the planes
//! that another frame sees in their place (projective association: Blais and Levine 1995; point to plane: Chen and Medioni
//! 1992) are made small by Gauss-Newton with Tukey's weights, and every correction is held near zero by the expected error of
//! a pose. So what no surface tells stays as it was told, and the mean correction stays near zero. Within a state all that is
//! seen stands still, the surroundings of the object included. Pieces that are held out decide whether the correction is used.

mod pairs;
mod surfels;

use std::fmt;

use nalgebra::{DMatrix, DVector, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use self::{
    pairs::{Comparison, median},
    surfels::Surfels,
};
use super::{NoiseConfig, RgbdFrame};
use crate::geometry::{Pose, log_so3};

/// Whether poses are corrected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RefinePoses {
    /// Where frames that were not used for it agree clearly better afterwards.
    #[default]
    Auto,
    /// They are taken as told.
    Never,
}

/// Expected errors of a pose along and about each axis, one standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PoseNoise {
    /// Metres.
    pub translation_m: f64,
    /// Radians.
    pub rotation_rad: f64,
}

impl PoseNoise {
    /// That of a hand-held camera, or of one on a calibrated arm: 5 mm and 0.5 degrees.
    const EXPECTED: Self = Self { translation_m: 0.005, rotation_rad: 0.0087 };

    /// By how much a point at some depth is off, one standard deviation, metres.
    fn displacement_m(&self, depth_m: f64) -> f64 {
        self.translation_m.hypot(self.rotation_rad * depth_m)
    }
}

/// What was found of the poses of a state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseCorrection {
    /// Whether it is used.
    pub used: bool,
    /// Root mean square of the corrections' lengths, metres, and angles, radians.
    pub translation_rms_m: f64,
    /// See `translation_rms_m`.
    pub rotation_rms_rad: f64,
    /// Robust standard deviation of the distances between surfaces that two frames see, held out, before and after, metres.
    pub residual_m: [f64; 2],
    /// Mean gain of the frames in its standard errors.
    pub gain_sigmas: f64,
}

impl fmt::Display for PoseCorrection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (mm, deg) = (1e3 * self.translation_rms_m, self.rotation_rms_rad.to_degrees());
        let [before_mm, after_mm] = self.residual_m.map(|m| 1e3 * m);
        if self.used {
            write!(f, "camera poses were corrected by {mm:.2} mm and {deg:.3} deg (root mean square); surfaces that frames share ")?;
            write!(f, "lay {before_mm:.2} mm apart, now {after_mm:.2} mm")
        } else {
            write!(f, "camera poses are taken as told: surfaces that frames share lie {before_mm:.2} mm apart, and a correction ")?;
            write!(f, "({mm:.2} mm, {deg:.3} deg) leaves {after_mm:.2} mm")
        }
    }
}

/// Rounds of association and Gauss-Newton at most.
const ROUNDS: usize = 12;
/// Rounds end when no camera moves further than this, metres (radians times one metre).
const STEP_M: f64 = 2e-5;
/// The held-out distances must fall by this share ...
const LEAST_GAIN: f64 = 0.05;
/// ... and the frames gain by so many standard errors in the mean.
const GAIN_SIGMAS: f64 = 4.0;
/// Fewest frames and fewest held-out pieces for a decision.
const LEAST_FRAMES: usize = 3;
const LEAST_PIECES: usize = 200;

/// Corrects the poses of one state, where that is borne out; `None` where too little is seen to tell.
#[must_use]
pub fn refine_poses(frames: &mut [RgbdFrame], noise: &NoiseConfig) -> Option<PoseCorrection> {
    if frames.len() < LEAST_FRAMES {
        return None;
    }
    let told: Vec<Pose> = frames.iter().map(|f| f.world_from_camera).collect();
    let surfels = frames.par_iter().map(|f| Surfels::of(f, noise)).collect();
    let comparison = Comparison::new(surfels, PoseNoise::EXPECTED);
    let found = solve(&comparison, &told);
    let correction = judge(&comparison, &told, &found)?;
    if correction.used {
        frames.iter_mut().zip(found).for_each(|(f, pose)| f.world_from_camera = pose);
    }
    Some(correction)
}

/// The poses that make the fitted pieces agree.
fn solve(comparison: &Comparison, told: &[Pose]) -> Vec<Pose> {
    let mut poses = told.to_vec();
    let mut scale = comparison.scale(&poses);
    for _ in 0..ROUNDS {
        let Some(step) = step(comparison, told, &poses, scale) else { break };
        for (pose, s) in poses.iter_mut().zip(step.as_slice().chunks_exact(6)) {
            *pose *= Pose::new(Vector3::new(s[0], s[1], s[2]), Vector3::new(s[3], s[4], s[5]));
        }
        scale = comparison.scale(&poses);
        if step.amax() < STEP_M {
            break;
        }
    }
    poses
}

/// One step of Gauss-Newton for all cameras, 6 values each: translation and rotation in its optical frame.
fn step(comparison: &Comparison, told: &[Pose], poses: &[Pose], scale: f64) -> Option<DVector<f64>> {
    let unknowns = 6 * poses.len();
    let (mut information, mut gradient) = (DMatrix::zeros(unknowns, unknowns), DVector::zeros(unknowns));
    for sums in comparison.sums(poses, scale) {
        let [i, j] = sums.frames.map(|f| 6 * f);
        let [own, between, other] = sums.information;
        for (r, c, block) in [(i, i, own), (i, j, between), (j, i, between.transpose()), (j, j, other)] {
            let mut place = information.fixed_view_mut::<6, 6>(r, c);
            place += block;
        }
        for (at, g) in [i, j].into_iter().zip(sums.gradient) {
            let mut place = gradient.fixed_rows_mut::<6>(at);
            place += g;
        }
    }
    let PoseNoise { translation_m, rotation_rad } = PoseNoise::EXPECTED;
    for (f, (told, pose)) in told.iter().zip(poses).enumerate() {
        let [moved, turned] = correction(told, pose);
        for k in 0..3 {
            for (at, value, sigma) in [(6 * f + k, moved[k], translation_m), (6 * f + 3 + k, turned[k], rotation_rad)] {
                information[(at, at)] += sigma.powi(-2);
                gradient[at] += value * sigma.powi(-2);
            }
        }
    }
    Some(-information.cholesky()?.solve(&gradient))
}

/// Translation, metres, and rotation vector, radians, of a correction in the camera's frame.
fn correction(told: &Pose, pose: &Pose) -> [Vector3<f64>; 2] {
    let change = told.inverse() * pose;
    [change.translation.vector, log_so3(&change.rotation)]
}

/// What the held-out pieces say of a correction; `None` where they are too few.
fn judge(comparison: &Comparison, told: &[Pose], found: &[Pose]) -> Option<PoseCorrection> {
    let changes = comparison.changes(told, found, comparison.scale(found));
    if changes.iter().map(|c| c.count).sum::<usize>() < LEAST_PIECES {
        return None;
    }
    let robust_m = |k: usize| median(changes.iter().flat_map(|c| c.distances_m[k].iter().copied()).collect()).map(|m| 1.4826 * m);
    let residual_m = [robust_m(0)?, robust_m(1)?];
    // Every frame is one observation: its pieces share its pose.
    let of_frame = |frame: usize| {
        let own = changes.iter().filter(|c| c.frame == frame);
        let (gain, count) = own.fold((0.0, 0), |(gain, count), c| (gain + c.gain, count + c.count));
        (count > 0).then(|| gain / count as f64)
    };
    let gains: Vec<f64> = (0..told.len()).filter_map(of_frame).collect();
    let count = gains.len() as f64;
    let mean = gains.iter().sum::<f64>() / count;
    let variance = gains.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    let gain_sigmas = mean / (variance / count).sqrt().max(1e-12);
    let corrections: Vec<[Vector3<f64>; 2]> = told.iter().zip(found).map(|(t, f)| correction(t, f)).collect();
    let rms = |k: usize| (corrections.iter().map(|c| c[k].norm_squared()).sum::<f64>() / corrections.len() as f64).sqrt();
    Some(PoseCorrection {
        used: gain_sigmas > GAIN_SIGMAS && residual_m[1] < (1.0 - LEAST_GAIN) * residual_m[0],
        translation_rms_m: rms(0),
        rotation_rms_rad: rms(1),
        residual_m,
        gain_sigmas,
    })
}

#[cfg(test)]
mod tests;
