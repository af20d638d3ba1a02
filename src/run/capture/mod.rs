//! The stage `capture`: from paths to frames of the object in one world.
//!
//! Its steps, each in a file: `read` the recordings, `track` the camera if they have no poses, `place` its
//! trajectories in one world, correct the `poses`, isolate and clean up the `object`. Every step checks
//! whether to stop and counts its finished views.

mod ahead;
mod board_world;
mod object;
mod place;
mod poses;
mod read;
mod steps;
mod track;
mod upright;
mod world_up;

use std::path::PathBuf;

use self::{
    object::{denoised, filled, isolated},
    place::posed,
    poses::corrected,
    read::{check_undivided, each_a_state, frames_of, measure_noise},
    steps::Steps,
    world_up::turned_upright,
};
use super::Monitor;
use ::capture::{Capture, CaptureConfig, CaptureError, PoseFindings, RefinePoses, TrackCamera};
use common::ahead::Ahead;
use common::note::{Note, NoteCode};
use geometry::Pose;
use io::{RecordedStates, Recording, Source, open_keyframes, open_start_end, poses_unused};

pub use ahead::work_ahead;

/// Number of steps that kept frames pass after decoding.
const STEPS_OF_FRAMES: usize = 4;

/// Opens paths: a bag per state, a folder with `state0`, `state1`, ..., one bag with both states, or a
/// dataset folder. Every frame of the result has a mask, and each state has at least one frame with depth on
/// the object. `seed` is the run's, from which the search for background planes draws. Work done `ahead` only
/// makes it faster.
///
/// # Errors
/// [`CaptureError`]; see its variants. Degradations are in [`Capture::warnings`].
pub fn open(
    sources: &[PathBuf],
    config: &CaptureConfig,
    seed: u64,
    ahead: &Ahead,
    monitor: &Monitor,
) -> Result<Capture, CaptureError> {
    open_inspected(sources, None, config, seed, ahead, monitor)
}

/// The same, where `inspect` may have read the bags already.
///
/// # Errors
/// Those of [`open`].
pub fn open_inspected(
    sources: &[PathBuf],
    recorded: Option<Vec<RecordedStates>>,
    config: &CaptureConfig,
    seed: u64,
    ahead: &Ahead,
    monitor: &Monitor,
) -> Result<Capture, CaptureError> {
    config.check()?;
    let source = Source::of(sources)?;
    let mut steps = Steps::new(monitor);
    let mut capture = posed_capture(&source, recorded, config, seed, ahead, &mut steps)?;
    let is_of_bags = matches!(source, Source::States(_) | Source::Both(_));
    let may_track = is_of_bags && config.tracking == TrackCamera::Auto && !config.asks_for_poses();
    if may_track && capture.tracking.is_empty() && are_contradicted(&capture.poses) {
        // What the images show is more certain. Where they show too little, the poses are what there is.
        let tracked = CaptureConfig { tracking: TrackCamera::Always, ..config.clone() };
        match posed_capture(&source, None, &tracked, seed, ahead, &mut steps) {
            Ok(mut tracked) => {
                let why = capture.warnings.iter().find(|w| w.code == NoteCode::PosesContradict);
                tracked.warnings.extend(why.map(|w| poses_unused(&w.text)));
                capture = tracked;
            }
            Err(CaptureError::Stopped(stopped)) => return Err(stopped.into()),
            Err(_) => {}
        }
    }
    let frames: usize = capture.states.iter().map(Vec::len).sum();
    steps.expects((STEPS_OF_FRAMES - 1) * frames);
    if is_of_bags && capture.tracking.is_empty() {
        turned_upright(&mut capture, config, &steps.stop)?;
    }
    let had_masks = capture.states.iter().flatten().all(|frame| frame.mask.is_some());
    isolated(&mut capture, config, seed, &steps.stop)?;
    steps.did(frames);
    // Denoising last: it works on the object's pixels and hides the measured noise.
    if config.denoise {
        denoised(&mut capture, &steps.stop)?;
    }
    steps.did(frames);
    // Without masks a pixel without depth may show anything.
    if had_masks {
        filled(&mut capture, config, seed, &steps.stop)?;
    }
    steps.did(frames);
    Ok(capture)
}

/// Whether the images contradict the poses of a state, and no delay explains that.
fn are_contradicted(found: &PoseFindings) -> bool {
    found.agreement.iter().flatten().any(|a| a.contradicts() && a.certain_delay_s().is_none())
}

/// The frames of a recording with corrected poses.
fn posed_capture(
    source: &Source,
    recorded: Option<Vec<RecordedStates>>,
    config: &CaptureConfig,
    seed: u64,
    ahead: &Ahead,
    steps: &mut Steps<'_>,
) -> Result<Capture, CaptureError> {
    let mut capture = match source {
        Source::States(paths) => {
            check_undivided(paths.len(), config)?;
            let recorded = recorded.map_or_else(|| each_a_state(paths, config, &steps.stop), Ok)?;
            posed_frames(source.states(), recorded, config, seed, ahead, steps)?
        }
        Source::Both(path) => {
            let divided = || Recording::open_divided(path, config, &steps.stop).map(|both| vec![both]);
            let recorded = recorded.map_or_else(divided, Ok)?;
            posed_frames(source.states(), recorded, config, seed, ahead, steps)?
        }
        Source::Keyframes(path) => open_keyframes(path, config, &steps.stop)?,
        Source::StartEnd(path) => open_start_end(path, config, &steps.stop)?,
    };
    capture.name = source.object_name();
    // Recordings that can be refused at once are refused before the costly steps.
    read::check_depth(&capture, config)?;
    read::check_states_differ(&capture)?;
    let frames = capture.states.iter().map(Vec::len).sum();
    steps.expects(STEPS_OF_FRAMES * frames);
    // Noise comes first (2.8): all later gates are multiples of it.
    measure_noise(&mut capture, config, &steps.stop)?;
    // Depth between readings is smoother than readings, so it has no part in the noise.
    read::close_gaps_in_depth(&mut capture, &steps.stop)?;
    // Poses before isolation, which combines the points of all frames.
    if config.refine_poses == RefinePoses::Auto {
        corrected(&mut capture, ahead, &steps.stop)?;
    }
    steps.did(frames);
    Ok(capture)
}

/// The frames of bags, with poses in one world.
fn posed_frames(
    states: usize,
    mut recorded: Vec<RecordedStates>,
    config: &CaptureConfig,
    seed: u64,
    ahead: &Ahead,
    steps: &mut Steps<'_>,
) -> Result<Capture, CaptureError> {
    let mut capture = Capture::of_states(states);
    posed(&mut capture, &mut recorded, config, seed, ahead, steps)?;
    frames_of(&mut capture, recorded, config, steps)?;
    Ok(capture)
}

/// Poses of the optical frame by stamp, nanoseconds, in the order of time.
pub type Trajectory = Vec<(i64, Pose)>;

/// The camera's trajectory through each state, tracked by its images whether or not poses were recorded; and
/// notes, then warnings, about it. The paths must be bags, one per state.
///
/// # Errors
/// Those of [`open`].
pub fn track_camera(
    sources: &[PathBuf],
    config: &CaptureConfig,
    seed: u64,
    monitor: &Monitor,
) -> Result<(Vec<Trajectory>, [Vec<Note>; 2]), CaptureError> {
    config.check()?;
    let config = &CaptureConfig { tracking: TrackCamera::Always, ..config.clone() };
    let paths = match Source::of(sources)? {
        Source::States(paths) => paths,
        // One trajectory, whatever states it shows.
        Source::Both(path) => vec![path],
        _ => {
            let why = "bags are tracked, one a state";
            return Err(CaptureError::NotTracked { state: 0, views: 0, why: why.to_owned() });
        }
    };
    let mut steps = Steps::new(monitor);
    let mut capture = Capture::of_states(paths.len());
    let mut recorded = each_a_state(&paths, config, &steps.stop)?;
    posed(&mut capture, &mut recorded, config, seed, &Ahead::default(), &mut steps)?;
    let trajectories = recorded.iter().map(posed_trajectory).collect();
    Ok((trajectories, [capture.notes, capture.warnings]))
}

/// Poses of a recording's posed views.
fn posed_trajectory(recorded: &RecordedStates) -> Trajectory {
    let views = recorded.recording.views.views.iter();
    views.filter_map(|v| Some((v.stamp_nanos, v.world_from_camera?))).collect()
}

#[cfg(test)]
mod tests;
