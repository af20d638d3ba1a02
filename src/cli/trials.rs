//! `artitwin trials`.

use std::{
    ffi::OsStr,
    path::{Path, PathBuf},
    sync::{Arc, atomic::AtomicBool},
};

use clap::Args;

use super::{
    exit::{CliError, Exit},
    progress::{Progress, Shown},
    stop::stop_on_request,
    terminal,
};
use config::{ABLATIONS, Config, Layers};
use run::{self, Method, Monitor, TrialsRequest};

/// Options of `trials`.
#[derive(Args, Clone, Debug)]
pub(super) struct TrialsArgs {
    /// Recordings with their truth beside them: truth.json, or trans.json of a published dataset
    #[arg(value_name = "OBJECT", required = true)]
    pub objects: Vec<PathBuf>,
    /// Presets to run, in the order of the table; NAME.yaml is a file of settings, as for --config
    #[arg(
        long,
        value_name = "PRESET,...",
        value_delimiter = ',',
        default_value = "default,fields,paper,paris,paris-depth,paris-depth-multi"
    )]
    pub methods: Vec<String>,
    /// Also run the preset paper without each of its terms
    #[arg(long)]
    pub ablate: bool,
    /// Trials of every object and method, with seeds 0, 1, ...
    #[arg(
        long,
        value_name = "N",
        default_value_t = 10,
        value_parser = clap::value_parser!(u16).range(1..=1000)
    )]
    pub seeds: u16,
    /// One setting of all methods, e.g. train.steps=500; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Folder that gets OBJECT/METHOD/seed_K, trials.json and trials.md. Trials that are there are not run
    /// again
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Events as lines of JSON on standard output
    #[arg(long)]
    pub json: bool,
}

/// The method of the ablations.
const ABLATED: &str = "paper";

/// Runs trials and prints their tables.
///
/// # Errors
/// Wrong settings; an object without truth; a stop request; a place without write access.
pub(super) fn run_trials(args: &TrialsArgs) -> Result<Exit, CliError> {
    let mut methods = Vec::new();
    for preset in &args.methods {
        let name = Path::new(preset).file_stem().and_then(OsStr::to_str).unwrap_or(preset);
        methods.push(trial_method(name, preset, &[], &args.set)?);
    }
    if args.ablate {
        if !args.methods.iter().any(|m| m == ABLATED) {
            methods.push(trial_method(ABLATED, ABLATED, &[], &args.set)?);
        }
        for (term, settings) in ABLATIONS {
            methods.push(trial_method(&format!("{ABLATED}_without_{term}"), ABLATED, settings, &args.set)?);
        }
    }
    let request = TrialsRequest {
        objects: args.objects.clone(),
        methods,
        seeds: u64::from(args.seeds),
        out: args.out.clone(),
    };
    let stop = Arc::new(AtomicBool::new(false));
    let (progress, events) = Progress::start(Shown { json: args.json, verbose: false }, Arc::clone(&stop));
    stop_on_request(events.clone(), Arc::clone(&stop))?;
    let table = run::trials(&request, &Monitor::new(events, stop));
    progress.finish().map_err(CliError::Events)?;
    let table = table?;
    if !args.json {
        terminal::print_result(&table.to_markdown())?;
    }
    let has_failed = table.trials.iter().any(|t| t.published.failed_trials > 0);
    Ok(if has_failed { Exit::Degraded } else { Exit::Done })
}

/// A preset, or a file of settings, with some settings under a name; typed settings win.
fn trial_method(name: &str, preset: &str, settings: &[&str], typed: &[String]) -> Result<Method, CliError> {
    let mut layers = Layers::new(&Config::default())?;
    if preset.ends_with(".yaml") {
        layers.add_file(Path::new(preset))?;
    } else {
        layers.add_preset(preset)?;
    }
    settings.iter().try_for_each(|s| layers.add_setting(s))?;
    typed.iter().try_for_each(|s| layers.add_setting(s))?;
    let resolved = Config::from_layers(layers)?;
    Ok(Method { name: name.to_owned(), config: resolved.config, origins: resolved.origins })
}
