//! `reconstruct` and `diagnose` as jobs: inputs and outputs by URIs, and `--estimate`.

use std::{
    path::PathBuf,
    sync::{Arc, atomic::AtomicBool},
};

use serde_json::{Value, json};

use super::{
    args::{DiagnoseArgs, ReconstructArgs},
    diagnose,
    exit::{CliError, Exit},
    progress::{Progress, Shown},
    render,
    stop::stop_on_request,
    terminal,
};
use crate::{
    capture::CaptureConfig,
    config::{Config, ConfigError, Resolved},
    gap::record::tracks::Streams,
    io::read_warnings,
    job::{Ended, JobInput, JobRequest, Local, Made, Reads, estimate, perform},
    run::{self, CheckpointError, DiagnoseOutcome, Event, Monitor, Outcome, ReconstructRequest, RunError},
};

/// Whether a reconstruction has to do with stores.
pub fn is_reconstruct_job(args: &ReconstructArgs) -> bool {
    args.job.estimate || reconstruct_request(args, &args.resolve()).names_a_store()
}

/// Whether a diagnosis has to do with stores.
pub fn is_diagnose_job(args: &DiagnoseArgs) -> bool {
    args.job.estimate || diagnose_request(args).names_a_store()
}

/// What a reconstruction asks of a job. Settings that cannot be used determine a refusal, as others do a
/// result.
fn reconstruct_request(
    args: &ReconstructArgs,
    resolved: &Result<Resolved<Config>, ConfigError>,
) -> JobRequest {
    let mut inputs: Vec<JobInput> =
        args.bags.iter().map(|bag| JobInput { given: bag.clone(), reads: Reads::Views }).collect();
    let config = resolved.as_ref().map(|r| r.config.clone()).unwrap_or_default();
    inputs.extend(config.matching.onnx.iter().map(|m| JobInput { given: m.clone(), reads: Reads::File }));
    let settings = match resolved {
        Ok(resolved) => {
            let mut config = resolved.config.clone();
            // It is an input, whose content counts.
            config.matching.onnx = None;
            serde_json::to_value(&config).unwrap_or_default()
        }
        Err(error) => json!([error.to_string(), format!("{:?} {:?}", args.settings, args.recording)]),
    };
    JobRequest {
        command: "reconstruct",
        name: args.output.name.clone(),
        inputs,
        settings,
        nodes: config.surface.nodes,
        capture: config.capture,
        streams: Streams::default(),
        out: args.output.out.clone(),
        scratch: args.job.scratch.clone(),
    }
}

/// What a diagnosis asks of a job.
fn diagnose_request(args: &DiagnoseArgs) -> JobRequest {
    let request = diagnose::request(args);
    let twin = if args.frames.is_empty() { Reads::Twin } else { Reads::TwinWithMeshes };
    let input = |reads| move |given: &PathBuf| JobInput { given: given.clone(), reads };
    let mut inputs = vec![input(twin)(&args.twin)];
    inputs.extend(args.runs.iter().map(input(Reads::Joints)));
    inputs.extend(args.held_out.iter().map(input(Reads::Joints)));
    inputs.extend(args.frames.iter().map(input(Reads::Frames)));
    let settings = json!({
        "runs": [args.runs.len(), args.held_out.len(), args.frames.len()],
        // Held-out runs that are among the runs are read once.
        "held_out": args.held_out.iter().map(|h| args.runs.iter().position(|r| r == h)).collect::<Vec<_>>(),
        "gravity": request.gravity,
        "effort_hold": args.effort_hold,
        "seed": request.seed,
        "effects": request.effects,
        "streams": format!("{:?}", request.streams),
        "actuators": format!("{:?}", request.told),
        "accuracy": args.accuracy,
    });
    JobRequest {
        command: "diagnose",
        name: args.output.name.clone(),
        inputs,
        settings,
        nodes: 0,
        capture: CaptureConfig::default(),
        streams: request.streams,
        out: args.output.out.clone(),
        scratch: args.job.scratch.clone(),
    }
}

/// Prints an estimate.
fn print_estimate(request: &JobRequest) -> Result<Exit, CliError> {
    let line = serde_json::to_string(&estimate(request)?).unwrap_or_default();
    terminal::print(&format!("{line}\n"))?;
    Ok(Exit::Done)
}

/// Runs a reconstruction as a job.
///
/// # Errors
/// Those of [`super::reconstruct::run`]; stores; a refusal.
pub fn reconstruct(args: &ReconstructArgs) -> Result<Exit, CliError> {
    let resolved = args.resolve();
    let request = reconstruct_request(args, &resolved);
    if args.job.estimate {
        resolved?;
        return print_estimate(&request);
    }
    if args.jobs.is_some() || args.rerun.is_some() || args.output.force || args.follow {
        return Err(CliError::Usage(
            "--jobs, --rerun, --follow and --force are for paths; a store takes one object a command, and \
             replaces nothing",
        ));
    }
    let mut made = None;
    let shown = Shown { json: args.json, verbose: args.output.verbose };
    let ended = watched(shown, |monitor| {
        perform(&request, monitor, |local| {
            let own = local_reconstruction(args, local, resolved?);
            let outcome = match run::reconstruct(&own, monitor) {
                // Left under the key by the same matcher at another place: it is of no use.
                Err(
                    RunError::Checkpoint(CheckpointError::OtherRun { .. }) | RunError::OtherResult { .. },
                ) if local.is_store => {
                    run::reconstruct(&ReconstructRequest { resume: false, ..own }, monitor)?
                }
                outcome => outcome?,
            };
            let warnings =
                if outcome.stood { read_warnings(&outcome.folder) } else { outcome.warnings.clone() };
            let folder = outcome.folder.clone();
            let degraded = !warnings.is_empty();
            made = Some(outcome);
            Ok(Made { folder, degraded, warnings })
        })
        .map_err(CliError::from)
    })?;
    let text = |outcome: Outcome| {
        let exit = if outcome.degraded { Exit::Degraded } else { Exit::Done };
        (render::outcome(&outcome), exit)
    };
    shown_end(ended, args.json, made.map(text))
}

fn local_reconstruction(
    args: &ReconstructArgs,
    local: &Local,
    resolved: Resolved<Config>,
) -> ReconstructRequest {
    let mut config = resolved.config;
    // It is the input behind the recordings, and may have been fetched.
    if let (Some(matcher), Some(here)) = (&mut config.matching.onnx, local.inputs.get(args.bags.len())) {
        matcher.clone_from(here);
    }
    ReconstructRequest {
        sources: local.inputs[..args.bags.len()].to_vec(),
        out: local.out.clone(),
        name: local.name.clone(),
        config,
        origins: resolved.origins,
        // What a process that was killed left under the key is of the same run.
        resume: if local.is_store { local.out.is_dir() } else { args.resume },
        keep: true,
        stages: args.stages.clone(),
        ahead: Arc::default(),
        force: false,
        rerun: None,
        beside: args.settings.config.iter().cloned().collect(),
        shown: local.shown.clone(),
    }
}

/// Runs a diagnosis as a job.
///
/// # Errors
/// Those of [`super::diagnose::run`]; stores; a refusal.
pub fn diagnose(args: &DiagnoseArgs) -> Result<Exit, CliError> {
    let request = diagnose_request(args);
    if args.job.estimate {
        return print_estimate(&request);
    }
    if args.output.force {
        return Err(CliError::Usage("--force is for paths; a store replaces nothing"));
    }
    let mut made = None;
    let shown = Shown { json: args.json, verbose: args.output.verbose };
    let ended = watched(shown, |monitor| {
        perform(&request, monitor, |local| {
            let (runs, held) = (args.runs.len(), args.held_out.len());
            let mut own = diagnose::request(args);
            own.twin = local.inputs[0].clone();
            own.runs = local.inputs[1..1 + runs].to_vec();
            own.held_out = local.inputs[1 + runs..1 + runs + held].to_vec();
            own.out = local.out.clone();
            own.name = local.name.clone();
            own.force = false;
            let outcome = diagnose::outcome(&own, &local.inputs[1 + runs + held..], args, monitor)?;
            let degraded = diagnose::ended(outcome.verdict, &outcome.warnings) == Exit::Degraded;
            let (folder, warnings) = (outcome.folder.clone(), outcome.warnings.clone());
            made = Some(outcome);
            Ok(Made { folder, degraded, warnings })
        })
        .map_err(CliError::from)
    })?;
    let text = |outcome: DiagnoseOutcome| {
        (diagnose::text(&outcome), diagnose::ended(outcome.verdict, &outcome.warnings))
    };
    shown_end(ended, args.json, made.map(text))
}

/// Runs with progress shown; an error is an event, too.
fn watched(shown: Shown, work: impl FnOnce(&Monitor) -> Result<Ended, CliError>) -> Result<Ended, CliError> {
    let stop = Arc::new(AtomicBool::new(false));
    let (progress, events) = Progress::start(shown, Arc::clone(&stop));
    let ended = stop_on_request(events.clone(), Arc::clone(&stop))
        .and_then(|()| work(&Monitor::new(events.clone(), stop)));
    let error = match &ended {
        Err(error) => Some((error.chain(), error.exit() as u8)),
        Ok(Ended::Manifest { message: Some(message), exit_code, .. }) => Some((message.clone(), *exit_code)),
        Ok(_) => None,
    };
    if let Some((message, exit_code)) = error {
        events.send(Event::Error { message, exit_code }).ok();
    }
    progress.finish().map_err(CliError::Events)?;
    ended
}

/// Prints how a job ended; `plain` is what its command says where no store keeps it.
fn shown_end(ended: Ended, json: bool, plain: Option<(String, Exit)>) -> Result<Exit, CliError> {
    let Ended::Manifest { uri, manifest, exit_code, message, stood } = ended else {
        let (text, exit) = plain.unwrap_or((String::new(), Exit::Done));
        if !json {
            terminal::print(&text)?;
        }
        return Ok(exit);
    };
    if json {
        terminal::print(&job_line(&manifest))?;
    } else {
        let text = |key: &str| manifest[key].as_str().unwrap_or_default().to_owned();
        let files = manifest["files"].as_array().map_or(0, Vec::len);
        let mut lines = format!("{uri}\n");
        if stood {
            lines += "  done before with the same inputs, settings and version; nothing was done\n";
        }
        lines += &match &message {
            Some(_) => format!("  {}\n", text("status")),
            None => format!("  {}: {files} files in {}\n", text("status"), text("folder")),
        };
        terminal::print(&lines)?;
    }
    match (message, exit_code) {
        (None, 3) => Ok(Exit::Degraded),
        (None, _) => Ok(Exit::Done),
        (Some(message), code) => Err(CliError::Refused { message, is_usage: code == Exit::Usage as u8 }),
    }
}

/// A manifest as an event.
fn job_line(manifest: &Value) -> String {
    let mut line = json!({"event": "job"});
    if let (Some(line), Some(manifest)) = (line.as_object_mut(), manifest.as_object()) {
        line.extend(manifest.clone());
    }
    format!("{line}\n")
}
