//! Computes results from the states' bags while these grow, in its own thread on one core.

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
    live_parameters::LiveParameters,
};
use ::io::GrowingState;
use common::ahead::Ahead;
use run::{Monitor, capture::work_ahead};

/// Time between checks for work.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// Starts the thread; returns its results. It ends when all holders of `shared` or `parameters` are gone.
///
/// # Errors
/// If no thread can be created.
pub(crate) fn start_thread(
    shared: &Arc<Shared>,
    parameters: &Arc<LiveParameters>,
) -> Result<Arc<Ahead>, NodeError> {
    let failed = |source| NodeError::System { what: "starting the work ahead", source };
    let ahead = Arc::new(Ahead::new());
    let found = Arc::clone(&ahead);
    let shared = Arc::downgrade(shared);
    let parameters = Arc::downgrade(parameters);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.map_err(|error| failed(io::Error::other(error)))?;
    let thread = Builder::new().name("ahead".into());
    thread.spawn(move || pool.install(|| work_while_shared(&shared, &parameters, &found))).map_err(failed)?;
    Ok(ahead)
}

fn work_while_shared(shared: &Weak<Shared>, parameters: &Weak<LiveParameters>, ahead: &Ahead) {
    let mut states: [Option<GrowingState>; 2] = [None, None];
    let mut collecting = None;
    let mut used = None;
    while let Some(shared) = shared.upgrade() {
        let snapshot = shared.snapshot();
        // A reconstruction has started to read and needs the CPU.
        let busy = shared.is_read();
        drop(shared);
        let Some(current) = parameters.upgrade().map(|p| p.current()) else { return };
        let config = &current.resolved.config;
        if used.as_ref() != Some(&config.capture) {
            used = Some(config.capture.clone());
            // What was read so far was read by other settings.
            states = [None, None];
        }
        if snapshot.collecting != collecting {
            collecting = snapshot.collecting;
            // A restarted state has another recording under the same name.
            collecting.and_then(|state| states.get_mut(state)).into_iter().for_each(|s| *s = None);
        }
        for (state, known) in states.iter_mut().enumerate().filter(|_| !busy) {
            let Some(path) = recording_of_state(&snapshot, state) else { continue };
            if known.as_ref().is_none_or(|k| k.path() != path) {
                *known = Some(GrowingState::new(&path, state));
            }
            let Some(known) = known else { continue };
            // A new state has too few views; a run reports what a finished one lacks.
            if let Ok(Some(grown)) =
                work_ahead(known, &config.capture, config.run.seed, ahead, &Monitor::silent())
            {
                log::debug!("state {state}: {} of {} views looked at ahead", grown.taken, grown.views);
            }
        }
        sleep(LOOK_EVERY);
    }
}

/// The recording of the state being collected, or of a finished one.
fn recording_of_state(snapshot: &Snapshot, state: usize) -> Option<PathBuf> {
    let finished = snapshot.recordings[state].clone();
    let is_growing = snapshot.collecting == Some(state);
    finished.or_else(|| is_growing.then(|| snapshot.session.join(format!("state{state}"))))
}
