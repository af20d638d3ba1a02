//! Reads a recording of an object at rest for a diagnosis by frames, with the object's masks.

use std::path::Path;

use capture::{Capture, CaptureConfig, CaptureError, RgbdFrame, isolate, noise_of};
use common::note::Note;
use common::stop::Stop;
use gap::camera::record::frames::FrameRun;
use numeric::random::stage_rng;

/// Reads a recording and isolates the object in it. Losses are added to `warnings`.
///
/// # Errors
/// [`CaptureError`] where the recording cannot be used.
pub(super) fn frame_run(
    path: &Path,
    seed: u64,
    warnings: &mut Vec<Note>,
    stop: &Stop,
) -> Result<FrameRun, CaptureError> {
    let config = CaptureConfig::default();
    let (mut run, of_positions) = io::read_frame_run(path, &config, warnings, stop)?;
    // Before isolation, whose gates are multiples of the noise.
    run.noise = noise_of(run.frames.iter(), &config, stop)?;
    with_masks(&mut run, &config, seed, warnings, stop)?;
    warnings.extend(of_positions);
    Ok(run)
}

/// Masks of the recording, or those from isolation; as isolation needs two states, each half of the views
/// stands for one.
fn with_masks(
    run: &mut FrameRun,
    config: &CaptureConfig,
    seed: u64,
    warnings: &mut Vec<Note>,
    stop: &Stop,
) -> Result<(), CaptureError> {
    if run.frames.len() < 2 {
        return Ok(());
    }
    let mut capture = Capture { noise: run.noise, ..Capture::of_states(2) };
    for (i, frame) in run.frames.drain(..).enumerate() {
        // Frames alternate, so both halves see the object from all sides.
        capture.states[i % 2].push(frame);
    }
    isolate(&mut capture, config, &mut stage_rng(seed, "diagnose/isolate", 0), stop)?;
    warnings.append(&mut capture.warnings);
    let mut all: Vec<RgbdFrame> = capture.states.into_iter().flatten().collect();
    all.sort_by_key(|f| f.stamp_nanos);
    run.frames = all;
    Ok(())
}
