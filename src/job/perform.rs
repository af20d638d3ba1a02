//! From a request to a manifest.

use std::{path::PathBuf, sync::Arc, time::Instant};

use serde_json::Value;

use super::{
    JobError, JobRequest, Manifest, Status,
    estimate::{Estimate, cost, seen_here},
    hold::Hold,
    job_error::may_pass,
    located::{Located, Place, Places},
    manifest::{FORMAT, Standing},
    output::Output,
    scratch::Scratch,
    usage::{now, usage},
};
use crate::{
    io::Glimpse,
    note::{Note, NoteCode},
    run::{Monitor, RunError, chain},
    store::{Created, StoreError, Traffic, fetch},
};

/// What the command's own work gets.
#[derive(Clone, Debug)]
pub struct Local {
    /// Inputs on this machine, in the order of the request.
    pub inputs: Vec<PathBuf>,
    /// Folder that gets the folder of the result.
    pub out: PathBuf,
    /// Name of the result; `None` where the request has none and the place is no store.
    pub name: Option<String>,
    /// Whether the place is a store: what an earlier process left is then continued.
    pub is_store: bool,
    /// What reports say in place of paths.
    pub shown: Vec<(PathBuf, String)>,
}

/// What the command's own work gives.
#[derive(Clone, Debug)]
pub struct Made {
    /// Folder of the result.
    pub folder: PathBuf,
    /// Whether the exit code says so.
    pub degraded: bool,
    /// What was lost or is uncertain.
    pub warnings: Vec<Note>,
}

/// How a job ended.
#[derive(Clone, Debug)]
pub enum Ended {
    /// Its place is no store; its command says the rest.
    Plain,
    /// With a manifest.
    Manifest {
        /// Where it stands.
        uri: String,
        /// What it says.
        manifest: Value,
        /// Exit code.
        exit_code: u8,
        /// Why it was refused.
        message: Option<String>,
        /// Whether it stood before.
        stood: bool,
    },
}

/// Does a job, unless its manifest stands. `work` is the command itself.
///
/// # Errors
/// [`JobError`]: what may pass. What the same inputs would meet again is a manifest, where the place is a
/// store.
pub fn perform(
    request: &JobRequest,
    monitor: &Monitor,
    work: &mut dyn FnMut(&Local) -> Result<Made, RunError>,
) -> Result<Ended, JobError> {
    let (started, begun) = (now(), Instant::now());
    let traffic = Arc::new(Traffic::default());
    let output = Output::of(&request.out, &traffic)?;
    let mut places = Places::of(request, &traffic)?;
    let (name, key) = (request.resolved_name(), places.key(request));
    if let Some(ended) = standing(&output, &key, monitor)? {
        return Ok(ended);
    }
    let _hold = match &output {
        Output::Folder(folder) => Some(Hold::take(folder.join(format!(".{key}.lock")))?),
        _ => None,
    };
    let needs_scratch = matches!(output, Output::Store(..)) || places.all.iter().any(Located::is_elsewhere);
    let mut scratch = needs_scratch.then(|| Scratch::open(request.scratch.as_deref(), &key)).transpose()?;
    // Again, as another process may have ended since.
    if let Some(ended) = standing(&output, &key, monitor)? {
        return Ok(ended);
    }
    let outcome = match brought(request, &mut places, scratch.as_ref(), &traffic, monitor) {
        Ok((inputs, shown, seen)) => {
            let local = Local {
                inputs,
                out: match (&output, &scratch) {
                    (Output::Plain(folder), _) => folder.clone(),
                    (Output::Folder(folder), _) => folder.join(&key),
                    (Output::Store(..), Some(scratch)) => scratch.results(),
                    (Output::Store(..), None) => request.out.clone(),
                },
                name: if output.is_store() { Some(name.clone()) } else { request.name.clone() },
                is_store: output.is_store(),
                shown,
            };
            ended(work(&local), &local, &output, &seen, request)
        }
        Err(error) if error.may_pass() => Err(error.into()),
        Err(error) if !output.is_store() => Err(error.into()),
        Err(error) => Ok((Refusal::of(&error).into(), None)),
    };
    let (outcome, estimate) = outcome.inspect_err(|_| keep(&mut scratch))?;
    if !output.is_store() {
        return Ok(Ended::Plain);
    }
    let (status, exit_code, message) = match &outcome {
        Outcome::Made(made) if made.degraded => (Status::Degraded, 3, None),
        Outcome::Made(_) => (Status::Done, 0, None),
        Outcome::Refused(refusal) => (Status::Refused, refusal.exit_code, Some(refusal.message.clone())),
    };
    let (files, warnings, folder) = match outcome {
        Outcome::Made(made) => {
            let files = output.put_result(&made.folder, &key, &name).inspect_err(|_| keep(&mut scratch))?;
            (files, made.warnings, Some(format!("{key}/{name}")))
        }
        Outcome::Refused(_) => Default::default(),
    };
    let (cpu_seconds, peak_memory_bytes) = usage();
    let transfer = places.transfer(&traffic);
    let estimate = estimate.map_or(Value::Null, |e| {
        let read = places.all.iter().map(|l| l.bytes_read).sum();
        let stored = places.all.iter().map(|l| l.bytes_stored).sum();
        let whole = Estimate { key: Some(key.clone()), bytes_stored: stored, bytes_read: read, ..e };
        serde_json::to_value(whole).unwrap_or_default()
    });
    let manifest = Manifest {
        format: FORMAT,
        key: key.clone(),
        command: request.command.to_owned(),
        name,
        status,
        exit_code,
        message: message.clone(),
        folder,
        files,
        warnings,
        version: env!("CARGO_PKG_VERSION"),
        transfer,
        inputs: places.all.iter().map(Located::found).collect(),
        seconds: begun.elapsed().as_secs_f64(),
        cpu_seconds,
        peak_memory_bytes,
        started,
        estimate,
    };
    let mut text = serde_json::to_vec_pretty(&manifest).unwrap_or_default();
    text.push(b'\n');
    match output.put_manifest(&key, &text).inspect_err(|_| keep(&mut scratch))? {
        // Another process did the same job meanwhile: what it wrote first is what stands.
        Created::Stood => match standing(&output, &key, monitor)? {
            Some(ended) => Ok(ended),
            None => Err(JobError::Store(StoreError::Missing(output.uri(&format!("{key}.json"))))),
        },
        Created::New => Ok(Ended::Manifest {
            uri: output.uri(&format!("{key}.json")),
            manifest: serde_json::from_slice(&text).unwrap_or_default(),
            exit_code,
            message,
            stood: false,
        }),
    }
}

fn keep(scratch: &mut Option<Scratch>) {
    if let Some(scratch) = scratch {
        scratch.keep();
    }
}

/// What became of the work.
enum Outcome {
    Made(Made),
    Refused(Refusal),
}

/// Why the same inputs and settings give no result.
struct Refusal {
    message: String,
    exit_code: u8,
}

impl Refusal {
    fn of(error: &StoreError) -> Self {
        Self { message: chain(error), exit_code: if error.is_usage() { 2 } else { 1 } }
    }
}

impl From<Refusal> for Outcome {
    fn from(refusal: Refusal) -> Self {
        Self::Refused(refusal)
    }
}

/// The work's result with its estimate; what may pass is an error.
fn ended(
    result: Result<Made, RunError>,
    local: &Local,
    output: &Output,
    seen: &[Vec<Glimpse>],
    request: &JobRequest,
) -> Result<(Outcome, Option<Estimate>), JobError> {
    let estimate = Some(cost(request, seen));
    match result {
        Ok(made) => Ok((Outcome::Made(made), estimate)),
        Err(error) if !output.is_store() => Err(JobError::Run(error)),
        Err(error) if may_pass(&error) => Err(JobError::MayPass(error)),
        Err(error) => {
            let message = shown_text(&chain(&error), &local.shown);
            let exit_code = if matches!(error, RunError::Config(_)) { 2 } else { 1 };
            // Nothing is left of what was never a result.
            if local.is_store {
                std::fs::remove_dir(&local.out).ok();
            }
            Ok((Outcome::Refused(Refusal { message, exit_code }), estimate))
        }
    }
}

/// A text with what is shown in place of paths.
fn shown_text(text: &str, shown: &[(PathBuf, String)]) -> String {
    shown.iter().fold(text.to_owned(), |text, (path, uri)| text.replace(&path.display().to_string(), uri))
}

/// The job's manifest, if it stands.
fn standing(output: &Output, key: &str, monitor: &Monitor) -> Result<Option<Ended>, JobError> {
    let Some(text) = output.manifest(key)? else { return Ok(None) };
    let uri = output.uri(&format!("{key}.json"));
    let damaged = |source| JobError::Manifest { uri: uri.clone(), source };
    let found: Standing = serde_json::from_slice(&text).map_err(damaged)?;
    let manifest: Value = serde_json::from_slice(&text).map_err(damaged)?;
    if found.format != FORMAT {
        return Err(damaged(serde::de::Error::custom(format!("its format is not {FORMAT}"))));
    }
    let text =
        format!("{uri} stands: the same inputs, settings and version were done; nothing is left to do");
    monitor.note(&Note::new(NoteCode::ResultStands, text));
    Ok(Some(Ended::Manifest {
        uri,
        manifest,
        exit_code: found.exit_code,
        message: found.message,
        stood: true,
    }))
}

/// Inputs on this machine, what is shown in place of their paths, and what was seen in each.
type Brought = (Vec<PathBuf>, Vec<(PathBuf, String)>, Vec<Vec<Glimpse>>);

fn brought(
    request: &JobRequest,
    places: &mut Places,
    scratch: Option<&Scratch>,
    traffic: &Traffic,
    monitor: &Monitor,
) -> Result<Brought, StoreError> {
    let (mut paths, mut shown, mut seen) = (Vec::new(), Vec::new(), Vec::new());
    let folder = scratch.map_or_else(|| PathBuf::from("."), Scratch::inputs);
    for located in &mut places.all {
        match &mut located.place {
            Place::Absent(error) => {
                return Err(error.take().unwrap_or(StoreError::Missing(located.given.clone())));
            }
            Place::Here(path) => {
                seen.push(seen_here(request, path, located.reads));
                paths.push(path.clone());
            }
            Place::Elsewhere(listing, bucket) => {
                let before = Traffic::get(&traffic.bytes_read);
                let wanted = request.wanted(located.reads);
                let (path, glimpses) = fetch(places.buckets[*bucket].1.as_ref(), listing, &folder, wanted)?;
                located.bytes_read = Traffic::get(&traffic.bytes_read) - before;
                note_fetched(located.bytes_read, located.bytes_stored, &located.given, monitor);
                shown.push((path.clone(), located.given.trim_end_matches('/').to_owned()));
                seen.push(glimpses);
                paths.push(path);
            }
        }
    }
    // The longest first: one may begin with another.
    shown.sort_by_key(|(path, _): &(PathBuf, String)| std::cmp::Reverse(path.as_os_str().len()));
    Ok((paths, shown, seen))
}

fn note_fetched(read: u64, stored: u64, given: &str, monitor: &Monitor) {
    let megabytes = |bytes: u64| bytes as f64 * 1e-6;
    let text = format!(
        "{given}: {:.1} of {:.1} MB were read, {:.0} %",
        megabytes(read),
        megabytes(stored),
        100.0 * read as f64 / stored.max(1) as f64
    );
    monitor.note(&Note::new(NoteCode::Fetched, text));
}
