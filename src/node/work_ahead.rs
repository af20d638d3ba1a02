//! What a run needs of the states' bags, worked out as they grow: on a thread of its own, of one core.

use std::{
    io,
    path::PathBuf,
    sync::{Arc, Weak},
    thread::{Builder, sleep},
    time::Duration,
};

use super::{
    collection::{Shared, Snapshot},
    error::NodeError,
};
use ::io::{Ahead, GrowingState};
use capture::CaptureConfig;
use config::Config;
use run::{Monitor, capture::work_ahead};

/// How often it is looked whether there is something to do.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// Starts the thread; what it works out. It ends with the last other holder of `shared`.
///
/// # Errors
/// If the system has no thread.
pub(crate) fn start(shared: &Arc<Shared>, config: &Config) -> Result<Arc<Ahead>, NodeError> {
    let failed = |source| NodeError::System { what: "starting the work ahead", source };
    let ahead = Arc::new(Ahead::new());
    let found = Arc::clone(&ahead);
    let shared = Arc::downgrade(shared);
    let capture = config.capture.clone();
    let seed = config.run.seed;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.map_err(|error| failed(io::Error::other(error)))?;
    let work = move || pool.install(|| work(&shared, &capture, seed, &found));
    Builder::new().name("ahead".into()).spawn(work).map_err(failed)?;
    Ok(ahead)
}

fn work(shared: &Weak<Shared>, config: &CaptureConfig, seed: u64, ahead: &Ahead) {
    let mut states: [Option<GrowingState>; 2] = [None, None];
    let mut collecting = None;
    while let Some(shared) = shared.upgrade() {
        let snapshot = shared.snapshot();
        // A run needs the processor, and has begun to read.
        let busy = shared.is_read();
        drop(shared);
        if snapshot.collecting != collecting {
            collecting = snapshot.collecting;
            // A state that begins again has another recording under the same name.
            collecting.and_then(|state| states.get_mut(state)).into_iter().for_each(|s| *s = None);
        }
        for (state, known) in states.iter_mut().enumerate().filter(|_| !busy) {
            let Some(path) = recording(&snapshot, state) else { continue };
            if known.as_ref().is_none_or(|k| k.path() != path) {
                *known = Some(GrowingState::new(&path, state));
            }
            let Some(known) = known else { continue };
            // Of one that has only begun there is not enough; a run says what one that is closed lacks.
            if let Ok(Some(grown)) = work_ahead(known, config, seed, ahead, &Monitor::silent()) {
                log::debug!("state {state}: {} of {} views looked at ahead", grown.taken, grown.views);
            }
        }
        sleep(LOOK_EVERY);
    }
}

/// Where a state is recorded, or was.
fn recording(snapshot: &Snapshot, state: usize) -> Option<PathBuf> {
    let growing = || snapshot.session.join(format!("state{state}"));
    snapshot.recordings[state].clone().or_else(|| (snapshot.collecting == Some(state)).then(growing))
}
