//! Many objects in one command, each in a run of its own, several at a time.

use std::sync::{
    Mutex, PoisonError,
    atomic::{AtomicUsize, Ordering},
};

use super::{
    Event, Monitor, Outcome, ReconstructRequest, RunError, chain,
    plan::{foreseen, settled},
    reconstruct,
};
use config::ConfigError;

/// Largest number of runs at a time.
pub(crate) const MAX_JOBS: usize = 64;

/// Reconstructs every object, `jobs` at a time; a failure does not stop the others. Results are in the order
/// of the requests and do not depend on `jobs`. Events carry the object's name: `fridge/register`.
///
/// All jobs share the machine's threads; there must be memory for `jobs` runs.
///
/// # Errors
/// Before any work, if two objects would get the same name.
pub fn reconstruct_all(
    requests: &[ReconstructRequest],
    jobs: usize,
    monitor: &Monitor,
) -> Result<Vec<Result<Outcome, RunError>>, RunError> {
    let names = names(requests)?;
    let next = AtomicUsize::new(0);
    let results =
        Mutex::new(requests.iter().map(|_| None).collect::<Vec<Option<Result<Outcome, RunError>>>>());
    let own = |i: usize| monitor.of_object(&names[i]);
    requests.iter().enumerate().for_each(|(i, request)| own(i).report(foreseen(request)));
    std::thread::scope(|scope| {
        for _ in 0..jobs.clamp(1, MAX_JOBS).min(requests.len()) {
            scope.spawn(|| {
                loop {
                    // Each free thread takes the next object: one needs seconds, another many minutes.
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    let Some(request) = requests.get(i) else { return };
                    let result = reconstruct_one(request, &own(i));
                    if let Some(slot) = results.lock().unwrap_or_else(PoisonError::into_inner).get_mut(i) {
                        *slot = Some(result);
                    }
                }
            });
        }
    });
    let results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(results
        .into_iter()
        .map(|result| {
            result.unwrap_or_else(|| Err(RunError::stage("capture", "the run ended without a result")))
        })
        .collect())
}

/// Reconstructs one object of several and reports how it ended.
fn reconstruct_one(request: &ReconstructRequest, monitor: &Monitor) -> Result<Outcome, RunError> {
    let result = monitor.check().map_err(RunError::from).and_then(|()| reconstruct(request, monitor));
    if let Err(error) = &result {
        // Reported at once, as the others may go on for hours.
        monitor.report(Event::Failed { message: chain(error) });
    }
    monitor.report(settled(request));
    result
}

/// The first path of a request; empty where it has none.
fn first_path(request: &ReconstructRequest) -> String {
    request.sources.first().map(|p| p.display().to_string()).unwrap_or_default()
}

/// The name of an object: the requested one, else its recording's, else its first path.
fn object_name(request: &ReconstructRequest) -> String {
    let name = request.name.clone().or_else(|| io::object_name(&request.sources).ok());
    name.unwrap_or_else(|| first_path(request))
}

/// The name of every object.
///
/// # Errors
/// If two objects have the same name.
fn names(requests: &[ReconstructRequest]) -> Result<Vec<String>, ConfigError> {
    let names: Vec<String> = requests.iter().map(object_name).collect();
    for (i, name) in names.iter().enumerate() {
        // They would overwrite each other in the output folder.
        if let Some(j) = names[..i].iter().position(|n| n == name) {
            return Err(ConfigError::SameName {
                name: name.clone(),
                first: first_path(&requests[j]),
                second: first_path(&requests[i]),
            });
        }
    }
    Ok(names)
}
