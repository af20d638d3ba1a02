//! Reads recordings: from paths to views, and from views to frames.

use std::path::PathBuf;

use super::steps::Steps;
use ::capture::{Capture, CaptureConfig, CaptureError, RgbdFrame, close_gaps, measured_noise};
use common::note::{Note, NoteCode};
use common::stop::Stop;
use io::{Decoded, RecordedStates, Recording, views_kept};

/// Noise of depth, relative to the expected one, below which its unit is in doubt where no poses tell it:
/// noise grows with the square of the distance, so depth that is N times too far has one N-th of what is
/// expected.
/// chosen: below that of structured light, above that of a unit of 0.25 mm
const DOUBTFUL_NOISE: f64 = 0.35;

/// Refuses to divide recordings that show one state each.
///
/// # Errors
/// [`CaptureError::Split`].
pub(super) fn check_undivided(recordings: usize, config: &CaptureConfig) -> Result<(), CaptureError> {
    // Refused, not ignored: the user must have meant one of the two.
    if config.split_secs.is_empty() && config.topics.marker.is_none() {
        return Ok(());
    }
    let reason = format!("a split was asked for, but {recordings} recordings were given, one per state");
    Err(CaptureError::Split { reason })
}

/// The recordings of all states, one a state, without pixels. All of them have poses, or none has.
///
/// # Errors
/// Those of [`Recording::open_states`].
pub(super) fn each_a_state(
    paths: &[PathBuf],
    config: &CaptureConfig,
    stop: &Stop,
) -> Result<Vec<RecordedStates>, CaptureError> {
    let recordings = Recording::open_states(paths, config, stop)?;
    Ok(recordings.into_iter().map(RecordedStates::of_one).collect())
}

/// Decodes the frames of kept views.
///
/// # Errors
/// Frames that take too much memory or cannot be used; states in other worlds than state 0.
pub(super) fn frames_of(
    capture: &mut Capture,
    recorded: Vec<RecordedStates>,
    config: &CaptureConfig,
    steps: &mut Steps<'_>,
) -> Result<(), CaptureError> {
    let mut found = Vec::new();
    for RecordedStates { recording, states } in recorded {
        let mut chosen = Vec::new();
        let mut notes = Vec::new();
        for (state, of_state) in states {
            let kept = recording.spread(&of_state, config);
            notes.push(views_kept(state, kept.len(), of_state.len()));
            chosen.extend(kept.into_iter().map(|v| (state, v)));
        }
        found.push((recording, chosen, notes));
    }
    // Before anything is decoded.
    let sizes: Vec<_> = found.iter().map(|(r, chosen, _)| r.views.sizes(chosen.len())).collect();
    config.check_memory(&sizes)?;
    let kept: usize = found.iter().map(|(_, chosen, _)| chosen.len()).sum();
    steps.expects((1 + super::STEPS_OF_FRAMES) * kept);
    let worlds: Vec<String> = found.iter().map(|(r, ..)| r.views.world_frame.clone()).collect();
    for (recording, chosen, notes) in found {
        capture.notes.extend(notes);
        add_frames(capture, recording, &chosen, config, &steps.stop)?;
        steps.did(chosen.len());
    }
    match (1..worlds.len()).find(|&k| worlds[k] != worlds[0]) {
        Some(state) => {
            Err(CaptureError::WorldFrames { world0: worlds[0].clone(), state, world1: worlds[state].clone() })
        }
        None => Ok(()),
    }
}

fn add_frames(
    capture: &mut Capture,
    recording: Recording,
    chosen: &[(usize, usize)],
    config: &CaptureConfig,
    stop: &Stop,
) -> Result<(), CaptureError> {
    let Decoded { frames, lost } = recording.decode(chosen, config, stop)?;
    for (state, frame) in frames {
        push_frame(capture, state, frame);
    }
    if let Some(first) = lost.first() {
        capture.warnings.push(Note::new(
            NoteCode::FramesBroken,
            format!("{} frames are broken and not used (first: {first})", lost.len()),
        ));
    }
    for state in chosen.iter().map(|(state, _)| *state) {
        if capture.states[state].is_empty() {
            let reason =
                format!("all {} are broken (first: {})", lost.len(), lost.first().map_or("", String::as_str));
            return Err(CaptureError::NoFrames { state, reason });
        }
    }
    capture.notes.extend(recording.views.notes);
    capture.warnings.extend(recording.views.warnings);
    Ok(())
}

fn push_frame(capture: &mut Capture, state: usize, mut frame: RgbdFrame) {
    frame.id = format!("{state}_{:04}", capture.states[state].len());
    capture.states[state].push(frame);
}

/// Refuses one recording given for two states: because of noise, the images of two recordings differ. Tracked
/// poses differ by the motion between the states.
pub(super) fn check_states_differ(capture: &Capture) -> Result<(), CaptureError> {
    let tracked = !capture.tracking.is_empty();
    let states = &capture.states;
    for second in 0..states.len() {
        for first in 0..second {
            if are_same_frames(&states[first], &states[second], tracked) {
                return Err(CaptureError::SameRecording { first, second });
            }
        }
    }
    Ok(())
}

/// Whether two states have the same images and depth, and the same poses unless these were `tracked`.
fn are_same_frames(a: &[RgbdFrame], b: &[RgbdFrame], tracked: bool) -> bool {
    a.len() == b.len()
        && a.iter().zip(b).all(|(a, b)| {
            let posed_alike = tracked || a.world_from_camera == b.world_from_camera;
            posed_alike && a.depth_m == b.depth_m && a.rgb == b.rgb
        })
}

/// Closes gaps of one pixel in depth that was brought to the pixels of a larger image.
pub(super) fn close_gaps_in_depth(capture: &mut Capture, stop: &Stop) -> Result<(), CaptureError> {
    if let Some(share) = close_gaps(&mut capture.states, stop)? {
        capture.notes.push(Note::new(
            NoteCode::GapsClosed,
            format!(
                "depth has gaps of one pixel, as images that were brought to the pixels of a larger one \
                 have: {:.0} for 100 readings; they got the depth between their neighbors",
                100.0 * share
            ),
        ));
    }
    Ok(())
}

/// Scales the noise model to the recording.
pub(super) fn measure_noise(
    capture: &mut Capture,
    config: &CaptureConfig,
    stop: &Stop,
) -> Result<(), CaptureError> {
    capture.noise = config.noise;
    if let Some(factor) = measured_noise(capture.states.iter().flatten(), config, stop)? {
        capture.noise = config.noise.scaled(factor);
        // Without poses nothing else shows the unit.
        if factor < DOUBTFUL_NOISE && !capture.tracking.is_empty() && config.depth_unit_m.is_none() {
            capture.warnings.push(Note::new(
                NoteCode::DepthUnit,
                format!(
                    "depth is {:.1} times more exact than a depth camera is at its distance: all lengths \
                     are by a unit of 1 mm, which may be too long; measure something, and give `--set \
                     capture.depth_unit_m=METERS` (0.0001 of a D405, 0.00025 of an L515, 0.0002 of TUM's \
                     recordings, 0.001 otherwise)",
                    1.0 / factor
                ),
            ));
        }
        capture.notes.push(Note::new(
            NoteCode::NoiseMeasured,
            format!(
                "depth noise is {factor:.2} times the model of the settings: {:.1} mm at 1 m",
                1e3 * capture.noise.sigma_m(1.0)
            ),
        ));
    }
    Ok(())
}

/// Refuses a state without any depth reading.
pub(super) fn check_depth(capture: &Capture, config: &CaptureConfig) -> Result<(), CaptureError> {
    for (state, frames) in capture.states.iter().enumerate() {
        if frames.is_empty() {
            return Err(CaptureError::NoFrames { state, reason: "the recording has none".into() });
        }
        if !frames.iter().any(|f| f.depth_m.iter().any(|d| *d > 0.0)) {
            return Err(CaptureError::NoDepth {
                state,
                frames: frames.len(),
                min_m: config.depth_min_m,
                max_m: config.depth_max_m,
            });
        }
    }
    Ok(())
}
