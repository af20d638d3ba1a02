//! `artitwin reconstruct`.

use std::{
    path::PathBuf,
    sync::{Arc, atomic::AtomicBool, mpsc::Sender},
};

use super::{
    args::ReconstructArgs,
    exit::{CliError, Exit},
    progress::{Progress, Shown},
    render,
    stop::stop_on_request,
    terminal,
};
use config::{Config, Resolved};
use run::{self, Event, Monitor, Outcome, ReconstructRequest, RunError};

/// Runs the pipeline, shows its progress, prints where the results lie.
///
/// # Errors
/// If the configuration is wrong, or a run fails or is stopped, or its events cannot be written: this stops
/// it, too. Of several objects the successful ones are there.
pub(super) fn run_reconstruct(args: &ReconstructArgs) -> Result<Exit, CliError> {
    let stop = Arc::new(AtomicBool::new(false));
    let (progress, events) =
        Progress::start(Shown { json: args.json, verbose: args.verbose }, Arc::clone(&stop));
    let outcomes = outcomes_of_objects(args, &events, &stop);
    if let Err(error) = &outcomes {
        events.send(Event::Error { message: error.chain(), exit_code: error.exit() as u8 }).ok();
    }
    // Before anything is printed: no bar is drawn over it.
    progress.finish().map_err(CliError::Events)?;
    let outcomes = outcomes?;
    let total = outcomes.len();
    let (done, failed): (Vec<_>, Vec<_>) = outcomes.into_iter().partition(Result::is_ok);
    let mut exit = Exit::Done;
    for outcome in done.into_iter().flatten() {
        if !args.json {
            terminal::print_result(&render::outcome_text(&outcome))?;
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
fn outcomes_of_objects(
    args: &ReconstructArgs,
    events: &Sender<Event>,
    stop: &Arc<AtomicBool>,
) -> Result<Vec<Result<Outcome, RunError>>, CliError> {
    // Before the handler is set: a wrong option ends the command at once.
    let resolved = args.resolved_config()?;
    if args.rerun.is_some() && !cfg!(feature = "rerun") {
        return Err(CliError::Usage(
            "this binary was built without rerun; build it with `cargo build --release --features rerun`",
        ));
    }
    stop_on_request(events.clone(), Arc::clone(stop))?;
    let monitor = Monitor::new(events.clone(), Arc::clone(stop));
    let Some(jobs) = args.jobs else {
        let topics = &resolved.config.capture.topics;
        if args.bags.len() > 1 && (!args.recording.split.is_empty() || topics.marker.is_some()) {
            return Err(CliError::Usage(
                "--split and a marker topic divide one recording, but one for each state was given; leave \
                 out one or the other",
            ));
        }
        let mut request = request_for(args, &resolved, args.bags.clone());
        if args.follow {
            request.ahead = Arc::new(run::follow(&request, &monitor)?);
        }
        // The error of a single run is the command's, with its own exit code.
        return Ok(vec![Ok(run::reconstruct(&request, &monitor)?)]);
    };
    let requests: Vec<ReconstructRequest> =
        args.bags.iter().map(|bag| request_for(args, &resolved, vec![bag.clone()])).collect();
    Ok(run::reconstruct_all(&requests, usize::from(jobs), &monitor)?)
}

/// The request for one object with the given recordings.
fn request_for(
    args: &ReconstructArgs,
    resolved: &Resolved<Config>,
    sources: Vec<PathBuf>,
) -> ReconstructRequest {
    ReconstructRequest {
        sources,
        out: args.output.out.clone(),
        name: args.output.name.clone(),
        config: resolved.config.clone(),
        origins: resolved.origins.clone(),
        resume: args.resume,
        keep: true,
        stages: args.stages.clone(),
        ahead: Arc::default(),
        force: args.output.force,
        rerun: args.rerun.clone(),
        // Of other objects too.
        beside: args.bags.iter().chain(&args.settings.changes.config).cloned().collect(),
    }
}
