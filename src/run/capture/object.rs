//! Isolates the object, denoises its depth, and fills holes in it from color.

use rayon::prelude::*;

use ::capture::{Capture, CaptureConfig, CaptureError, denoise, fill_from_color, isolate};
use common::note::{Note, NoteCode};
use common::stop::Stop;
use numeric::random::stage_rng;

/// Gives every frame its mask.
pub(super) fn isolated(
    capture: &mut Capture,
    config: &CaptureConfig,
    seed: u64,
    stop: &Stop,
) -> Result<(), CaptureError> {
    isolate(capture, config, &mut stage_rng(seed, "capture/isolate", 0), stop)
}

/// Removes noise from the object's depth.
pub(super) fn denoised(capture: &mut Capture, stop: &Stop) -> Result<(), CaptureError> {
    let noise = capture.noise;
    let frames = capture.states.par_iter_mut().flat_map(|frames| frames.par_iter_mut());
    Ok(frames.try_for_each(|frame| denoise(frame, &noise, stop))?)
}

/// Fills the sensor's missing depth from color, and reports it.
pub(super) fn filled(
    capture: &mut Capture,
    config: &CaptureConfig,
    seed: u64,
    stop: &Stop,
) -> Result<(), CaptureError> {
    let noise = capture.noise;
    for (state, frames) in capture.states.iter_mut().enumerate() {
        let found = fill_from_color(frames, &noise, config.color_depth, seed, stop)?;
        let Some(found) = found else { continue };
        capture.notes.push(Note::new(
            NoteCode::DepthFromColor,
            format!(
                "state {state}: {:.1} % of the object is far from any depth; {:.0} % of its pixels without \
                 depth got one from color, good to {:.2} %",
                100.0 * found.unread,
                100.0 * found.filled as f64 / found.holes.max(1) as f64,
                100.0 * found.relative_sigma
            ),
        ));
    }
    Ok(())
}
