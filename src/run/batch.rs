//! Many objects in one command: each a run of its own, some at a time.

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

/// Runs that may go on at once, at most.
pub(crate) const MAX_JOBS: usize = 64;

/// Reconstructs every object, `jobs` at a time; one that fails does not stop the rest. Results are in the
/// order of the requests and do not depend on `jobs`. Events carry the object's name: `fridge/register`.
///
/// All jobs share the threads of the machine; memory is that of `jobs` runs.
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
    let work = || {
        loop {
            // Whoever is free takes the next object: one needs seconds, another many minutes.
            let i = next.fetch_add(1, Ordering::Relaxed);
            let Some(request) = requests.get(i) else { return };
            let own = own(i);
            let result = own.check().map_err(RunError::from).and_then(|()| reconstruct(request, &own));
            if let Err(error) = &result {
                // At once, as the others may go on for hours.
                own.report(Event::Failed { message: chain(error) });
            }
            own.report(settled(request));
            if let Some(slot) = results.lock().unwrap_or_else(PoisonError::into_inner).get_mut(i) {
                *slot = Some(result);
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..jobs.clamp(1, MAX_JOBS).min(requests.len()) {
            scope.spawn(work);
        }
    });
    let results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    let missing = || Err(RunError::stage("capture", "the run ended without a result"));
    Ok(results.into_iter().map(|r| r.unwrap_or_else(missing)).collect())
}

/// The name of every object: that of the request, else of its recording; the path where that cannot be read.
fn names(requests: &[ReconstructRequest]) -> Result<Vec<String>, ConfigError> {
    let path =
        |r: &ReconstructRequest| r.sources.first().map(|p| p.display().to_string()).unwrap_or_default();
    let name = |r: &ReconstructRequest| {
        r.name.clone().or_else(|| io::object_name(&r.sources).ok()).unwrap_or_else(|| path(r))
    };
    let names: Vec<String> = requests.iter().map(name).collect();
    for (i, name) in names.iter().enumerate() {
        // They would take each other's place in the output folder.
        if let Some(j) = names[..i].iter().position(|n| n == name) {
            return Err(ConfigError::SameName {
                name: name.clone(),
                first: path(&requests[j]),
                second: path(&requests[i]),
            });
        }
    }
    Ok(names)
}
