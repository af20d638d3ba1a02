//! Correction of camera pose errors by surfaces seen in several frames. See docs/method.md (2.13).
//!
//! All poses of all states, and the smooth errors of the depth sensor, are solved for jointly. Residuals are
//! the distances of small flat patches (surfels) of one frame from the planes at their place in another frame
//! (projective association: Blais and Levine 1995; point to plane: Chen and Medioni 1992). Gauss-Newton with
//! Tukey's weights minimizes them, and a prior with the size of the pose errors keeps corrections small; the
//! size is estimated too (marginal likelihood). Undetermined motions (along a wall, say) remain as reported,
//! and the mean correction stays near zero. The whole scene is assumed to be static within a state. Held-out
//! surfels decide whether a correction is used.
//!
//! There remains the mean error of a state's poses. Surfaces static across states determine it as one motion
//! of the world. Then the views of all states are solved for as one (`joined`).

mod agreement;
mod correction;
pub(super) mod depth_warp;
pub(super) mod drift;
mod error_draw;
mod inverse;
mod joined;
pub(super) mod landmarks;
pub(super) mod observed;
pub(super) mod pairs;
pub(super) mod pose_noise;
mod reading_weights;
mod residual_scale;
mod sensor;
pub(super) mod sensor_errors;
pub(super) mod sensor_sums;
mod solve;
pub(super) mod surfels;
mod trajectory;
mod window_planes;
pub(super) mod world;

use std::iter;

use nalgebra::{Point3, Vector6};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use self::{
    agreement::PoseAgreement,
    correction::PoseCorrection,
    error_draw::ErrorDraw,
    pose_noise::PoseNoise,
    sensor::SensorCalibration,
    world::{WorldCorrection, align_worlds},
};
use self::{
    correction::Refined,
    depth_warp::DepthWarp,
    joined::{Joined, JoinedPoses},
    landmarks::Landmarks,
    pairs::Matches,
    sensor::Calibrated,
    solve::Problem,
    surfels::Surfels,
    trajectory::Trajectory,
};
use super::{NoiseConfig, RgbdFrame};
use common::{
    ahead::Ahead,
    stop::{Stop, Stopped},
};
use geometry::Pose;

/// Whether poses are corrected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RefinePoses {
    /// Where the held-out readings agree clearly better afterwards.
    #[default]
    Auto,
    /// Poses remain as reported.
    Never,
}

/// Fewest frames of a state for a correction.
const LEAST_FRAMES: usize = 3;

/// The corrections of all states' poses and of the sensor.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PoseFindings {
    /// Pose correction of each state; `None` where none was computed, or too little is seen.
    pub states: Vec<Option<PoseCorrection>>,
    /// Per state, how far the poses agree with the images; `None` where too few features match.
    pub agreement: Vec<Option<PoseAgreement>>,
    /// Calibration of the depth sensor; `None` where none was computed, or too little is seen.
    pub sensor: Option<SensorCalibration>,
    /// World correction of every further state against state 0, where poses were corrected.
    pub worlds: Vec<Option<WorldCorrection>>,
    /// Draws of the remaining errors of poses and depth; empty where nothing was corrected.
    pub draws: Vec<ErrorDraw>,
}

impl PoseFindings {
    /// Expected error of the mean pose of a state.
    fn mean_noise(&self, state: usize, states: &[Vec<RgbdFrame>]) -> PoseNoise {
        let noise = self.states[state].as_ref().map_or(PoseNoise::EXPECTED, |c| c.noise);
        noise.of_mean(states[state].len())
    }

    /// Whether any pose was changed.
    #[must_use]
    pub fn has_changes(&self) -> bool {
        self.states.iter().flatten().any(|s| s.used)
    }

    /// Root mean square error of state 0 as a whole at a world point: meters and radians. `None` where
    /// nothing was corrected: reported poses define the world frame, and the recording shows no error of it.
    #[must_use]
    pub fn frame_deviation(&self, frames: &[RgbdFrame], middle: &Point3<f64>) -> Option<[f64; 2]> {
        let covered = self.draws.iter().all(|d| d.covers(0, frames.len()));
        if self.draws.is_empty() || frames.is_empty() || !covered {
            return None;
        }
        let mut sum = [0.0; 2];
        for draw in &self.draws {
            let [moved, turned] = draw.mean_motion_of_first_state(frames, middle).map(|v| v.norm_squared());
            sum = [sum[0] + moved, sum[1] + turned];
        }
        Some(sum.map(|square| (square / self.draws.len() as f64).sqrt()))
    }
}

/// The correction of each state by its poses alone; `None` without a problem to solve or without a gain.
fn refined_alone(problems: &[Option<Problem<'_>>]) -> Result<Vec<Option<Refined>>, Stopped> {
    let refined =
        problems.par_iter().map(|problem| problem.as_ref().map_or(Ok(None), Refined::of_state_alone));
    refined.collect()
}

/// Corrects the poses of every state and the depth of all, where held-out surfels then agree clearly better.
/// `tracked` poses come from the same frames, so the best fit is always used, and its uncertainty is their
/// error. Features found `ahead` are not searched again.
///
/// # Errors
/// [`Stopped`]; the frames are then only partly corrected.
pub fn refine_poses(
    states: &mut [Vec<RgbdFrame>],
    noise: &NoiseConfig,
    tracked: bool,
    ahead: &Ahead,
    stop: &Stop,
) -> Result<PoseFindings, Stopped> {
    let surfels_of = |f: &RgbdFrame| stop.check().map(|()| Surfels::of_frame(f, noise, |_| true));
    let mut surfels: Vec<Vec<Surfels>> = states
        .par_iter()
        .map(|frames| frames.par_iter().map(surfels_of).collect())
        .collect::<Result<_, Stopped>>()?;
    let landmarks = Landmarks::find_in_states(states, &mut surfels, noise, ahead, stop)?;
    let within: Vec<Matches> = states
        .par_iter()
        .enumerate()
        .map(|(s, f)| landmarks.matches_within(s, f, stop))
        .collect::<Result<_, Stopped>>()?;
    // 0. Late poses, or poses of another scene, cannot be corrected by the next steps.
    let agreement = pose_agreements(states, &surfels, &within, stop)?;
    let reported: Vec<Vec<Pose>> = states.iter().map(|frames| world::poses_of(frames)).collect();
    let problems: Vec<Option<Problem<'_>>> = states
        .par_iter()
        .zip(&surfels)
        .zip(within.clone())
        .map(|((frames, surfels), matches)| problem_of_state(frames, surfels, matches, tracked, stop))
        .collect();
    // 1. Each state alone: the sensor must improve on the best poses alone.
    // 2. All states with their sensor.
    let (alone, together) =
        rayon::join(|| refined_alone(&problems), || sensor::solve_together(states, &problems));
    let alone = alone?;
    let calibrated = match together? {
        Some(solution) => sensor::calibrated_sensor(states, &problems, &alone, solution)?,
        None => None,
    };
    let (mut found, calibration, warps) = match calibrated {
        Some(Calibrated { calibration, states, warps }) if calibration.used => {
            (states, Some(calibration), warps)
        }
        other => (alone, other.map(|c| c.calibration), Vec::new()),
    };
    drop(problems);
    // 3. Depth, poses and surfels are replaced together, since they were estimated together.
    let camera = states.iter().flatten().next().map(|f| f.intrinsics);
    if let (Some(used), Some(camera)) = (calibration.as_ref().filter(|c| c.used), camera) {
        let errors = used.sensor_errors(&camera);
        for frames in states.iter_mut() {
            stop.check()?;
            errors.warp.correct_frames(frames.iter_mut());
        }
        for frame in states.iter_mut().flatten() {
            stop.check()?;
            used.move_color(iter::once(frame));
        }
        surfels.iter_mut().for_each(|s| *s = Surfels::all_corrected(s, &errors));
    }
    let draws = error_draws(states, &found, warps);
    for (frames, refined) in states.iter_mut().zip(&mut found) {
        let Some(refined) = refined.as_mut().filter(|r| r.correction.used) else { continue };
        frames.iter_mut().zip(refined.poses.drain(..)).for_each(|(f, pose)| f.world_from_camera = pose);
    }
    let found = found.into_iter().map(|r| r.map(|r| r.correction)).collect();
    // Poses that need no correction have no mean error either.
    let mut findings =
        PoseFindings { states: found, agreement, sensor: calibration, worlds: Vec::new(), draws };
    if !findings.has_changes() {
        return Ok(findings);
    }
    // 4. The mean error of each state relative to state 0.
    let mut with_first = Vec::with_capacity(states.len());
    for s in 1..states.len() {
        let expected = findings.mean_noise(0, states).of_difference(&findings.mean_noise(s, states));
        let matches = landmarks.matches_between([0, s], [&states[0], &states[s]], stop)?;
        with_first.push(matches.clone());
        let poses = [0, s].map(|s| world::poses_of(&states[s]));
        let poses = poses.each_ref().map(Vec::as_slice);
        let found = world::corrected_world(poses, [&*surfels[0], &*surfels[s]], matches, &expected, stop)?;
        if let Some((_, follow)) = &found {
            findings.draws.iter_mut().for_each(|draw| follow.apply_to_draw([0, s], draw));
        }
        findings.worlds.push(found.map(|(correction, _)| correction));
    }
    for (frames, world) in states.iter_mut().skip(1).zip(&findings.worlds) {
        if let Some(correction) = world.as_ref().map(|w| w.corrected_from_reported) {
            frames.iter_mut().for_each(|f| f.world_from_camera = correction * f.world_from_camera);
        }
    }
    // 5. All views of all states, by what stands still across them.
    if let Some((errors, reported)) = joined::at_rest(&findings, reported) {
        let counts: Vec<usize> = states.iter().map(Vec::len).collect();
        let found = states.iter().flat_map(|frames| world::poses_of(frames)).collect();
        let matches = joined::all_matches(within, with_first.into_iter(), &counts);
        let surfels = surfels.into_iter().flatten().collect();
        let joined = Joined { surfels, reported, found, matches, errors };
        if let Some(JoinedPoses { poses, draws }) = joined.most_likely_poses(&findings.draws, stop)? {
            let frames = states.iter_mut().flatten();
            frames.zip(poses).for_each(|(frame, pose)| frame.world_from_camera = pose);
            for (draw, errors) in findings.draws.iter_mut().zip(draws) {
                draw.poses.iter_mut().flatten().zip(errors).for_each(|(before, error)| *before = error);
            }
        }
    }
    Ok(findings)
}

/// How far the poses of each state agree with its images; corrects the delay of clearly late poses.
fn pose_agreements(
    states: &mut [Vec<RgbdFrame>],
    surfels: &[Vec<Surfels>],
    within: &[Matches],
    stop: &Stop,
) -> Result<Vec<Option<PoseAgreement>>, Stopped> {
    let agreement: Vec<Option<PoseAgreement>> = states
        .par_iter()
        .zip(surfels)
        .zip(within)
        .map(|((frames, surfels), matches)| {
            PoseAgreement::of_state(&Trajectory::of_frames(frames), surfels, matches, stop)
        })
        .collect::<Result<_, Stopped>>()?;
    for (frames, found) in states.iter_mut().zip(&agreement) {
        if let Some(delay_s) = found.and_then(|f| f.certain_delay_s()) {
            let poses = Trajectory::of_frames(frames).delayed_poses(delay_s);
            frames.iter_mut().zip(poses).for_each(|(f, pose)| f.world_from_camera = pose);
        }
    }
    Ok(agreement)
}

/// Draws of the remaining errors of corrected poses and of depth.
fn error_draws(
    states: &[Vec<RgbdFrame>],
    found: &[Option<Refined>],
    warps: Vec<DepthWarp>,
) -> Vec<ErrorDraw> {
    let used = || found.iter().map(|r| r.as_ref().filter(|r| r.correction.used));
    let count = used().flatten().map(|r| r.draws.len()).max().unwrap_or(0);
    let mut draws = Vec::with_capacity(count);
    for d in 0..count {
        let mut poses = Vec::with_capacity(states.len());
        for (refined, frames) in used().zip(states) {
            // Uncorrected poses are taken as exact.
            let own = refined.and_then(|r| r.draws.get(d).cloned());
            poses.push(own.unwrap_or_else(|| vec![Vector6::zeros(); frames.len()]));
        }
        draws.push(ErrorDraw { poses, warp: warps.get(d).cloned() });
    }
    draws
}

/// The pose problem of one state; `None` where too little is seen.
fn problem_of_state<'a>(
    frames: &[RgbdFrame],
    surfels: &'a [Surfels],
    matches: Matches,
    tracked: bool,
    stop: &Stop,
) -> Option<Problem<'a>> {
    // In a coarse image, pose errors below a pixel are lost in its steps.
    let mut focal_px = frames.iter().map(|f| f.intrinsics.fx.min(f.intrinsics.fy));
    let has_coarse = focal_px.any(|focal_px| focal_px * PoseNoise::EXPECTED.rotation_rad < 1.0);
    (frames.len() >= LEAST_FRAMES && !has_coarse)
        .then(|| Problem::new(surfels, matches, &Trajectory::of_frames(frames), tracked, stop))
}

#[cfg(test)]
mod tests;
