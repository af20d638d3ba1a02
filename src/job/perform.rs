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
    run::{Monitor, RunError, chain, shown_text},
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
    work: impl FnOnce(&Local) -> Result<Made, RunError>,
) -> Result<Ended, JobError> {
    let traffic = Arc::new(Traffic::default());
    let output = Output::of(&request.out, &traffic)?;
    let places = Places::of(request, &traffic)?;
    let (name, key) = (request.resolved_name(), places.key(request));
    let mut job =
        Job { request, monitor, traffic, output, places, name, key, started: now(), begun: Instant::now() };
    if let Some(ended) = job.standing()? {
        return Ok(ended);
    }
    let _hold = match &job.output {
        Output::Folder(folder) => Some(Hold::take(folder.join(format!(".{}.lock", job.key)))?),
        _ => None,
    };
    let elsewhere = job.places.all.iter().any(Located::is_elsewhere);
    let needs_scratch = elsewhere || matches!(job.output, Output::Store(..));
    let mut scratch =
        needs_scratch.then(|| Scratch::open(request.scratch.as_deref(), &job.key)).transpose()?;
    // Again, as another process may have ended since.
    if let Some(ended) = job.standing()? {
        return Ok(ended);
    }
    job.done(scratch.as_ref(), work).inspect_err(|error| {
        // What was fetched and made serves the next try.
        if let Some(scratch) = scratch.as_mut().filter(|_| error.can_continue()) {
            scratch.keep();
        }
    })
}

/// A job on its way.
struct Job<'a> {
    request: &'a JobRequest,
    monitor: &'a Monitor,
    traffic: Arc<Traffic>,
    output: Output,
    places: Places,
    name: String,
    key: String,
    started: String,
    begun: Instant,
}

impl Job<'_> {
    /// Fetches, works, and puts result and manifest.
    fn done(
        &mut self,
        scratch: Option<&Scratch>,
        work: impl FnOnce(&Local) -> Result<Made, RunError>,
    ) -> Result<Ended, JobError> {
        let (outcome, estimate) = self.worked(scratch, work)?;
        if !self.output.is_store() {
            return Ok(Ended::Plain);
        }
        let manifest = self.manifest(outcome, estimate)?;
        let mut text = serde_json::to_vec_pretty(&manifest).unwrap_or_default();
        text.push(b'\n');
        let uri = self.output.uri(&format!("{}.json", self.key));
        match self.output.put_manifest(&self.key, &text)? {
            // Another process did the same job meanwhile: what it wrote first is what stands.
            Created::Stood => self.standing()?.ok_or(JobError::Store(StoreError::Missing(uri))),
            Created::New => Ok(Ended::Manifest {
                uri,
                manifest: serde_json::from_slice(&text).unwrap_or_default(),
                exit_code: manifest.exit_code,
                message: manifest.message,
                stood: false,
            }),
        }
    }

    /// What became of the work, with its estimate; what may pass is an error.
    fn worked(
        &mut self,
        scratch: Option<&Scratch>,
        work: impl FnOnce(&Local) -> Result<Made, RunError>,
    ) -> Result<(Outcome, Option<Estimate>), JobError> {
        let (inputs, shown, seen) = match self.brought(scratch) {
            Ok(brought) => brought,
            Err(error) if error.may_pass() || !self.output.is_store() => return Err(error.into()),
            Err(error) => return Ok((Outcome::Refused(Refusal::of(&error)), None)),
        };
        let local = Local {
            inputs,
            out: match (&self.output, scratch) {
                (Output::Folder(folder), _) => folder.join(&self.key),
                (Output::Store(..), Some(scratch)) => scratch.results(),
                _ => self.request.out.clone(),
            },
            name: if self.output.is_store() { Some(self.name.clone()) } else { self.request.name.clone() },
            is_store: self.output.is_store(),
            shown,
        };
        let estimate = Some(cost(self.request, &seen));
        match work(&local) {
            Ok(made) => Ok((Outcome::Made(made), estimate)),
            Err(error) if !local.is_store => Err(JobError::Run(error)),
            Err(error) if may_pass(&error) => Err(JobError::MayPass(error)),
            Err(error) => {
                let message = shown_text(&chain(&error), &local.shown);
                let exit_code = if matches!(error, RunError::Config(_)) { 2 } else { 1 };
                // Nothing is left of what was never a result.
                std::fs::remove_dir(&local.out).ok();
                Ok((Outcome::Refused(Refusal { message, exit_code }), estimate))
            }
        }
    }

    /// The manifest of an outcome, whose files are put before.
    fn manifest(&self, outcome: Outcome, estimate: Option<Estimate>) -> Result<Manifest, JobError> {
        let (status, exit_code, message) = match &outcome {
            Outcome::Made(made) if made.degraded => (Status::Degraded, 3, None),
            Outcome::Made(_) => (Status::Done, 0, None),
            Outcome::Refused(refusal) => (Status::Refused, refusal.exit_code, Some(refusal.message.clone())),
        };
        let (files, warnings, folder) = match outcome {
            Outcome::Made(made) => {
                let files = self.output.put_result(&made.folder, &self.key, &self.name)?;
                (files, made.warnings, Some(format!("{}/{}", self.key, self.name)))
            }
            Outcome::Refused(_) => Default::default(),
        };
        let (cpu_seconds, peak_memory_bytes) = usage();
        let all = &self.places.all;
        let estimate = estimate.map_or(Value::Null, |e| {
            let bytes_stored = all.iter().map(|l| l.bytes_stored).sum();
            let bytes_read = all.iter().map(|l| l.bytes_read).sum();
            let whole = Estimate { key: Some(self.key.clone()), bytes_stored, bytes_read, ..e };
            serde_json::to_value(whole).unwrap_or_default()
        });
        Ok(Manifest {
            format: FORMAT,
            key: self.key.clone(),
            command: self.request.command.to_owned(),
            name: self.name.clone(),
            status,
            exit_code,
            message,
            folder,
            files,
            warnings,
            version: env!("CARGO_PKG_VERSION"),
            transfer: self.places.transfer(&self.traffic),
            inputs: all.iter().map(Located::found).collect(),
            seconds: self.begun.elapsed().as_secs_f64(),
            cpu_seconds,
            peak_memory_bytes,
            started: self.started.clone(),
            estimate,
        })
    }

    /// The job's manifest, if it stands.
    fn standing(&self) -> Result<Option<Ended>, JobError> {
        let Some(text) = self.output.manifest(&self.key)? else { return Ok(None) };
        let uri = self.output.uri(&format!("{}.json", self.key));
        let damaged = |source| JobError::Manifest { uri: uri.clone(), source };
        let found: Standing = serde_json::from_slice(&text).map_err(damaged)?;
        let manifest: Value = serde_json::from_slice(&text).map_err(damaged)?;
        if found.format != FORMAT {
            return Err(damaged(serde::de::Error::custom(format!("its format is not {FORMAT}"))));
        }
        let text =
            format!("{uri} stands: the same inputs, settings and version were done; nothing is left to do");
        self.monitor.note(&Note::new(NoteCode::ResultStands, text));
        let Standing { exit_code, message, .. } = found;
        Ok(Some(Ended::Manifest { uri, manifest, exit_code, message, stood: true }))
    }

    /// Has all inputs on this machine.
    fn brought(&mut self, scratch: Option<&Scratch>) -> Result<Brought, StoreError> {
        let (mut paths, mut shown, mut seen) = (Vec::new(), Vec::new(), Vec::new());
        let folder = scratch.map_or_else(|| PathBuf::from("."), Scratch::inputs);
        for located in &mut self.places.all {
            match &mut located.place {
                Place::Absent(error) => {
                    return Err(error.take().unwrap_or(StoreError::Missing(located.given.clone())));
                }
                Place::Here(path) => {
                    seen.push(seen_here(self.request, path, located.reads));
                    paths.push(path.clone());
                }
                Place::Elsewhere(listing, bucket) => {
                    let before = Traffic::get(&self.traffic.bytes_read);
                    let wanted = self.request.wanted(located.reads);
                    let bucket = self.places.buckets[*bucket].1.as_ref();
                    let (path, glimpses) = fetch(bucket, listing, &folder, wanted)?;
                    located.bytes_read = Traffic::get(&self.traffic.bytes_read) - before;
                    note_fetched(located.bytes_read, located.bytes_stored, &located.given, self.monitor);
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
}

/// Inputs on this machine, what is shown in place of their paths, and what was seen in each.
type Brought = (Vec<PathBuf>, Vec<(PathBuf, String)>, Vec<Vec<Glimpse>>);

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
