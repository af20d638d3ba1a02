//! `artitwin reconstruct`.

use std::{
    path::PathBuf,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::Sender,
    },
};

use super::{
    args::ReconstructArgs,
    exit::{CliError, Exit},
    progress::Progress,
    render,
};
use crate::run::{self, Event, Monitor, Outcome, ReconstructRequest, RunError};

/// Runs the pipeline, shows its progress, prints where the results lie.
///
/// # Errors
/// If the configuration is wrong, or a run fails or is stopped. Of several objects those that succeeded are there.
pub fn run(args: &ReconstructArgs) -> Result<Exit, CliError> {
    let (progress, events) = Progress::start(args.json);
    let outcomes = reconstruct(args, &events);
    if let Err(error) = &outcomes {
        events.send(Event::Error { message: error.chain(), exit_code: error.exit() as u8 }).ok();
    }
    progress.finish();
    let outcomes = outcomes?;
    let total = outcomes.len();
    let (done, failed): (Vec<_>, Vec<_>) = outcomes.into_iter().partition(Result::is_ok);
    let mut exit = Exit::Done;
    for outcome in done.into_iter().flatten() {
        if !args.json {
            super::print(&render::outcome(&outcome))?;
        }
        if outcome.degraded {
            exit = Exit::Degraded;
        }
    }
    let errors: Vec<RunError> = failed.into_iter().filter_map(Result::err).collect();
    if errors.is_empty() {
        return Ok(exit);
    }
    let cancelled = errors.iter().any(|e| matches!(e, RunError::Cancelled(_)));
    Err(CliError::Batch { failed: errors.len(), total, cancelled })
}

/// The outcome of every object.
fn reconstruct(args: &ReconstructArgs, events: &Sender<Event>) -> Result<Vec<Result<Outcome, RunError>>, CliError> {
    let resolved = args.resolve()?;
    let request = |sources: Vec<PathBuf>| ReconstructRequest {
        sources,
        out: args.out.clone(),
        name: args.name.clone(),
        config: resolved.config.clone(),
        origins: resolved.origins.clone(),
        resume: args.resume,
        keep: true,
    };
    let monitor = Monitor::new(events.clone(), stop_on_request(events.clone())?);
    let Some(jobs) = args.jobs else {
        if args.bags.len() > 1 && (!args.split.is_empty() || args.marker_topic.is_some()) {
            return Err(CliError::Usage(
                "--split and --marker-topic divide one recording, but one for each state was given; leave out one or the other",
            ));
        }
        return Ok(vec![Ok(run::reconstruct(&request(args.bags.clone()), &monitor)?)]);
    };
    let requests: Vec<ReconstructRequest> = args.bags.iter().map(|bag| request(vec![bag.clone()])).collect();
    Ok(run::reconstruct_all(&requests, usize::from(jobs), &monitor)?)
}

/// A flag that the first Ctrl-C (or SIGTERM) sets; the second ends the process.
fn stop_on_request(events: Sender<Event>) -> Result<Arc<AtomicBool>, CliError> {
    let stop = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&stop);
    ctrlc::set_handler(move || {
        if asked.swap(true, Ordering::Relaxed) {
            std::process::exit(Exit::Cancelled as i32);
        }
        events
            .send(Event::Note {
                message: "stopping after this step; ask again to stop at once: finished stages are kept either way".to_owned(),
            })
            .ok();
    })?;
    Ok(stop)
}
