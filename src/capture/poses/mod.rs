//! Errors of the camera poses, found by what frames see of the same surfaces. See docs/method.md (2.13).
//!
//! All poses of a state are solved for together: distances between small flat patches of surface (surfels) in
//! one frame and the planes that another frame sees in their place (projective association: Blais and Levine
//! 1995; point to plane: Chen and Medioni 1992) are made small by Gauss-Newton with Tukey's weights, and
//! every correction is held near zero by the size of the errors, which is found from the corrections
//! (expectation maximization). A motion that no surface shows (along a wall, say) is left as reported, and
//! the mean correction stays near zero. Within a state all that is seen stands still, the surroundings of the
//! object included. Surfels that are held out decide whether a correction is used.
//!
//! The mean error of a state's poses is then left; surfaces that stand still between the states show it, as
//! one motion of a world.

mod pairs;
mod pose_noise;
mod solve;
mod surfels;
mod world;

use std::fmt;

use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use self::{
    pairs::{Comparison, Gain},
    solve::{correction, solve},
    surfels::Surfels,
};
pub use self::{
    pose_noise::PoseNoise,
    world::{WorldCorrection, align_worlds},
};
use super::{NoiseConfig, RgbdFrame};
use crate::geometry::Pose;

/// Whether poses are corrected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RefinePoses {
    /// Where readings that were not used for it agree clearly better afterwards.
    #[default]
    Auto,
    /// Poses are used as reported.
    Never,
}

/// What was found of the poses of a state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseCorrection {
    /// Whether it is used.
    pub used: bool,
    /// Root mean square of the corrections' lengths, meters.
    pub translation_rms_m: f64,
    /// Root mean square of their angles, radians.
    pub rotation_rms_rad: f64,
    /// Robust standard deviation of the distances between surfaces that two frames see, held out, before and
    /// after, meters.
    pub residual_m: [f64; 2],
    /// Mean gain of the frames in its standard errors.
    pub gain_sigmas: f64,
    /// Size of the errors.
    pub noise: PoseNoise,
}

impl fmt::Display for PoseCorrection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (mm, deg) = (1e3 * self.translation_rms_m, self.rotation_rms_rad.to_degrees());
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

/// The held-out distances must fall by this share ...
const LEAST_GAIN: f64 = 0.05;
/// ... and the frames gain by so many standard errors in the mean.
const GAIN_SIGMAS: f64 = 4.0;
/// Fewest frames for a decision.
const LEAST_FRAMES: usize = 3;

/// What was found of the poses of all states.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PoseFindings {
    /// Of each state; `None` where it was not looked for, or too little is seen to decide.
    pub states: Vec<Option<PoseCorrection>>,
    /// Of the mean error of every other state against that of state 0, where poses were corrected.
    pub worlds: Vec<Option<WorldCorrection>>,
}

impl PoseFindings {
    /// Whether any pose was changed.
    #[must_use]
    pub fn changed(&self) -> bool {
        self.states.iter().flatten().any(|s| s.used)
    }

    /// Errors of a state's poses as reported, where they were corrected.
    #[must_use]
    pub fn noise(&self, state: usize) -> Option<PoseNoise> {
        self.states.get(state)?.as_ref().filter(|s| s.used).map(|s| s.noise)
    }
}

/// Corrects the poses of every state whose held-out surfels then agree clearly better.
#[must_use]
pub fn refine_poses(states: &mut [Vec<RgbdFrame>], noise: &NoiseConfig) -> PoseFindings {
    let surfels: Vec<Vec<Surfels>> = states
        .iter()
        .map(|frames| frames.par_iter().map(|f| Surfels::of(f, noise, |_| true)).collect())
        .collect();
    let found =
        states.iter_mut().zip(&surfels).map(|(frames, surfels)| refine_state(frames, surfels)).collect();
    // Poses that need no correction are taken to be right in the mean, too.
    let mut findings = PoseFindings { states: found, worlds: Vec::new() };
    if !findings.changed() {
        return findings;
    }
    let mean_noise = |s: usize| {
        let noise = findings.states[s].as_ref().map_or(PoseNoise::EXPECTED, |c| c.noise);
        noise.of_mean(states[s].len())
    };
    let world = |s: usize| {
        let expected = mean_noise(0).beside(&mean_noise(s));
        world::correct([&states[0], &states[s]], [&surfels[0], &surfels[s]], &expected)
    };
    findings.worlds = (1..states.len()).map(world).collect();
    for (frames, world) in states.iter_mut().skip(1).zip(&findings.worlds) {
        if let Some(correction) = world.as_ref().map(|w| w.corrected_from_reported) {
            frames.iter_mut().for_each(|f| f.world_from_camera = correction * f.world_from_camera);
        }
    }
    findings
}

/// Corrects the poses of one state if its held-out surfels then agree clearly better; `None` where too
/// little is seen to decide.
fn refine_state(frames: &mut [RgbdFrame], surfels: &[Surfels]) -> Option<PoseCorrection> {
    let count = frames.len();
    // Errors smaller than a pixel cannot be distinguished from the steps of a coarse image.
    let coarse =
        |f: &RgbdFrame| f.intrinsics.fx.min(f.intrinsics.fy) * PoseNoise::EXPECTED.rotation_rad < 1.0;
    if count < LEAST_FRAMES || frames.iter().any(coarse) {
        return None;
    }
    let reported: Vec<Pose> = frames.iter().map(|f| f.world_from_camera).collect();
    let pairs = (0..count).flat_map(|i| (0..count).filter(move |j| *j != i).map(move |j| [i, j])).collect();
    let comparison = Comparison::new(surfels.iter().collect(), pairs, PoseNoise::EXPECTED);
    let (found, noise) = solve(&comparison, &reported);
    let Gain { sigmas, residual_m } = comparison.gain(&reported, &found)?;
    let corrections: Vec<[Vector3<f64>; 2]> =
        reported.iter().zip(&found).map(|(r, f)| correction(r, f)).collect();
    let rms = |k: usize| (corrections.iter().map(|c| c[k].norm_squared()).sum::<f64>() / count as f64).sqrt();
    let used = sigmas > GAIN_SIGMAS && residual_m[1] < (1.0 - LEAST_GAIN) * residual_m[0];
    if used {
        frames.iter_mut().zip(found).for_each(|(f, pose)| f.world_from_camera = pose);
    }
    Some(PoseCorrection {
        used,
        translation_rms_m: rms(0),
        rotation_rms_rad: rms(1),
        residual_m,
        gain_sigmas: sigmas,
        noise,
    })
}

#[cfg(test)]
mod tests;
