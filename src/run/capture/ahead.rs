//! What a run needs of recordings, worked out while they grow.

use std::time::Instant;

use super::track::track;
use crate::Monitor;
use ::capture::{CaptureConfig, CaptureError};
use io::{Ahead, GrowingState, Grown, TrackedOf};

/// Works out what a run would have to, of what is new: features of the images that it would take, and of
/// a closed recording without poses the camera's way. `None` where nothing is new, or it was read just
/// now.
///
/// # Errors
/// [`CaptureError`]: of a recording that has only begun, nothing to mind.
pub fn work_ahead(
    growing: &mut GrowingState,
    config: &CaptureConfig,
    seed: u64,
    ahead: &Ahead,
    monitor: &Monitor,
) -> Result<Option<Grown>, CaptureError> {
    let stop = monitor.stop();
    let begun = Instant::now();
    let Some(grown) = growing.read_new(config, &stop)? else { return Ok(None) };
    for frame in &grown.frames {
        stop.check()?;
        ahead.features.look_at(frame);
    }
    if let Some(recording) = &grown.to_track {
        let state = (growing.state(), seed);
        let of = TrackedOf::now(&recording.bag, config, state);
        if let Some(of) = of.filter(|of| !ahead.knows(of)) {
            let all = recording.all();
            let found = track(recording, &all, config, state, &ahead.features, &stop, &mut || {})?;
            ahead.keep(of, found);
        }
    }
    growing.rest_after(begun.elapsed());
    Ok(Some(grown))
}
