//! Does work for a run while its recordings still grow.

use std::{sync::Arc, time::Instant};

use super::track::{StateSeed, track, tracked_key};
use crate::Monitor;
use ::capture::{CaptureConfig, CaptureError, look_at};
use common::ahead::Ahead;
use io::{GrowingState, Grown};

/// Does a run's work on new views: image features and, for a closed recording without poses, camera tracking.
/// `None` if nothing is new, or the recording was read just now.
///
/// # Errors
/// [`CaptureError`]; it is not serious if the recording has only just begun.
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
        look_at(frame, ahead);
    }
    if let Some(recording) = &grown.to_track {
        let state = StateSeed { state: growing.state(), seed };
        let key = tracked_key(&recording.bag.files, config, state);
        if let Some(key) = key.filter(|key| !ahead.knows(key)) {
            let found = track(recording, &recording.all(), config, state, ahead, &stop, &mut || {})?;
            ahead.keep(key, 1, Arc::new(found));
        }
    }
    growing.rest_after(begun.elapsed());
    Ok(Some(grown))
}
