//! `artitwin reconstruct`.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
    mpsc::Sender,
};

use super::{
    args::ReconstructArgs,
    exit::{CliError, Exit},
    progress::Progress,
    render,
};
use crate::run::{self, Event, Monitor, Outcome, ReconstructRequest};

/// Runs the pipeline, shows its progress, prints where the result lies.
///
/// # Errors
/// If the configuration is wrong, or the run fails or is stopped.
pub fn run(args: &ReconstructArgs) -> Result<Exit, CliError> {
    let (progress, events) = Progress::start(args.json);
    let outcome = reconstruct(args, &events);
    if let Err(error) = &outcome {
        events.send(Event::Error { message: error.chain(), exit_code: error.exit() as u8 }).ok();
    }
    progress.finish();
    let outcome = outcome?;
    if !args.json {
        super::print(&render::outcome(&outcome))?;
    }
    Ok(exit(&outcome))
}

fn reconstruct(args: &ReconstructArgs, events: &Sender<Event>) -> Result<Outcome, CliError> {
    let resolved = args.resolve()?;
    let request = ReconstructRequest {
        sources: std::iter::once(&args.bag).chain(&args.bag1).cloned().collect(),
        out: args.out.clone(),
        name: args.name.clone(),
        config: resolved.config,
        origins: resolved.origins,
        resume: args.resume,
    };
    let stop = stop_on_request(events.clone())?;
    Ok(run::reconstruct(&request, &Monitor::new(events.clone(), stop))?)
}

fn exit(outcome: &Outcome) -> Exit {
    if outcome.degraded { Exit::Degraded } else { Exit::Done }
}

/// A flag that the first Ctrl-C (or SIGTERM) sets; the second ends the process.
fn stop_on_request(events: Sender<Event>) -> Result<Arc<AtomicBool>, CliError> {
    let stop = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&stop);
    ctrlc::set_handler(move || {
        if asked.swap(true, Ordering::Relaxed) {
            std::process::exit(Exit::Cancelled as i32);
        }
        events.send(Event::Note { message: "stopping after this step; ask again to stop at once".to_owned() }).ok();
    })?;
    Ok(stop)
}
