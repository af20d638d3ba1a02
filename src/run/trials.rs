//! Trials: objects times methods times seeds, each in a run of its own. Finished trials are kept. A failed
//! run is a result too: its reason is kept and shown in the tables.

use std::{
    fs,
    path::{Path, PathBuf},
    time::Instant,
};

use serde::{Deserialize, Serialize};

use super::{
    Monitor, ReconstructRequest, RunError,
    admission::fingerprint,
    chain,
    outcome::{CHECK_STAGE, OUTPUT_STAGE},
    plan::{foreseen, settled},
    reconstruct,
};
use common::files;
use common::limits::REPORT;
use config::{Config, Origins};
use evaluate::{self, EvaluateError, EvaluateOptions, PUBLISHED_MIN_COMPONENT, TrialCost, TrialTable, Truth};

/// Named settings.
#[derive(Clone, Debug)]
pub struct Method {
    /// Name in tables and folders.
    pub name: String,
    /// Settings.
    pub config: Config,
    /// Where the settings came from.
    pub origins: Origins,
}

/// Request for trials.
#[derive(Clone, Debug)]
pub struct TrialsRequest {
    /// Recordings with their ground truth beside them.
    pub objects: Vec<PathBuf>,
    /// Methods, in the order of the tables.
    pub methods: Vec<Method>,
    /// Number of seeds (0, 1, ...) for every object and method.
    pub seeds: u64,
    /// Folder for `OBJECT/METHOD/seed_K`, `trials.json` and `trials.md`.
    pub out: PathBuf,
}

/// Why trials ended.
#[derive(Debug, thiserror::Error)]
pub enum TrialsError {
    /// A run was stopped, or could not be begun or written.
    #[error(transparent)]
    Run(#[from] RunError),
    /// An object has no ground truth, or two objects have the same name.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    /// Two objects would use the same folder.
    #[error("two objects are named {0}: rename a folder, or give them to two commands")]
    SameName(String),
    /// A file that trials did not write has the name of a result.
    #[error("{} was not written by trials: move it, or give another --out", .0.display())]
    Taken(PathBuf),
    /// A file could not be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
}

/// The record of a trial that is kept beside its twin.
#[derive(Serialize, Deserialize)]
struct TrialRecord {
    fingerprint: String,
    #[serde(flatten)]
    cost: TrialCost,
    failed: Option<String>,
    /// Why a simulator would not load the twin as intended; the twin is measured all the same.
    rejected: Option<String>,
}

/// Runs all unfinished trials, and measures all. Methods with the published inference get the true number of
/// parts, as the published methods do; others find it.
///
/// # Errors
/// If an object has no ground truth, a stop is requested, or the place cannot be written. A run that fails
/// because of its inputs is not an error but a failed trial.
pub fn trials(request: &TrialsRequest, monitor: &Monitor) -> Result<TrialTable, TrialsError> {
    let tables = ["trials.json", "trials.md"].map(|name| request.out.join(name));
    let is_own = is_table(&tables[0]);
    if let Some(taken) = tables.iter().find(|path| path.exists() && !is_own) {
        return Err(TrialsError::Taken(taken.clone()));
    }
    let mut objects: Vec<TrialObject> = Vec::new();
    for path in &request.objects {
        let name = io::object_name(std::slice::from_ref(path)).map_err(|e| RunError::stage("capture", e))?;
        if objects.iter().any(|o| o.name == name) {
            return Err(TrialsError::SameName(name));
        }
        objects.push(TrialObject { name, path, truth: evaluate::read_truth(path)? });
    }
    let options =
        EvaluateOptions { min_component: Some(PUBLISHED_MIN_COMPONENT), ..EvaluateOptions::default() };
    let mut table = TrialTable::new(request.seeds);
    for (object, method) in objects.iter().flat_map(|o| request.methods.iter().map(move |m| (o, m))) {
        for seed in 0..request.seeds {
            let run = object.trial_request(method, &request.out, seed);
            object.trial_monitor(method, seed, monitor).report(foreseen(&run));
        }
    }
    for object in &objects {
        for method in &request.methods {
            let mut records = Vec::new();
            let mut runs = Vec::new();
            for seed in 0..request.seeds {
                let own = object.trial_monitor(method, seed, monitor);
                let run = object.trial_request(method, &request.out, seed);
                let record = trial(&run, &own)?;
                own.report(settled(&run));
                runs.push(result_folder(&run, &record));
                records.push(record);
            }
            let mut measured = evaluate::evaluate_trials(&runs, &object.truth, &options);
            for (trial, record) in measured.iter_mut().zip(&mut records).filter(|(_, r)| r.failed.is_some()) {
                trial.failed = record.failed.take();
            }
            let rejected = records.iter_mut().map(|r| r.rejected.take()).collect();
            table.add_trials(
                &object.name,
                &method.name,
                &measured,
                rejected,
                records.iter().map(|r| r.cost).collect(),
            );
        }
    }
    put(&tables[0], table.to_json().as_bytes())?;
    put(&tables[1], table.to_markdown().as_bytes())?;
    Ok(table)
}

/// Whether a file is a table of trials.
fn is_table(path: &Path) -> bool {
    let text = files::read_text(path, REPORT).unwrap_or_default();
    let value: serde_json::Value = serde_json::from_str(&text).unwrap_or_default();
    value["seeds"].is_u64() && value["trials"].is_array()
}

fn seed_name(seed: u64) -> String {
    format!("seed_{seed}")
}

/// An object of trials.
struct TrialObject<'a> {
    name: String,
    path: &'a PathBuf,
    truth: Truth,
}

impl TrialObject<'_> {
    /// Reports events under the names of object, method and seed.
    fn trial_monitor(&self, method: &Method, seed: u64, monitor: &Monitor) -> Monitor {
        monitor.of_object(&format!("{}/{}/{}", self.name, method.name, seed_name(seed)))
    }

    /// The run of a trial, with its result in the folder `out/object/method/seed`.
    fn trial_request(&self, method: &Method, out: &Path, seed: u64) -> ReconstructRequest {
        let mut request = ReconstructRequest::new([self.path], out.join(&self.name).join(&method.name));
        request.name = Some(seed_name(seed));
        request.config = method.config.clone();
        request.origins = method.origins.clone();
        request.config.run.seed = seed;
        if method.config.takes_two_states() {
            request.config.run.parts = Some(self.truth.parts.len());
        }
        (request.resume, request.keep) = (true, true);
        request
    }
}

/// Runs a trial, or returns its kept record.
fn trial(request: &ReconstructRequest, monitor: &Monitor) -> Result<TrialRecord, TrialsError> {
    monitor.check().map_err(RunError::from)?;
    let name = request.name.clone().unwrap_or_default();
    let path = request.out.join(format!("{name}.json"));
    let fingerprint = fingerprint(request)?.text();
    let text = files::read_text(&path, REPORT).ok();
    let kept: Option<TrialRecord> = text.and_then(|text| serde_json::from_str(&text).ok());
    if kept.is_none() && path.exists() {
        return Err(TrialsError::Taken(path));
    }
    if let Some(kept) = kept.filter(|k| k.fingerprint == fingerprint)
        && (kept.failed.is_some() || result_folder(request, &kept).is_dir())
    {
        return Ok(kept);
    }
    forget_peak();
    let started = Instant::now();
    let (failed, rejected) = match reconstruct(request, monitor) {
        Ok(_) => (None, None),
        // The files have been written.
        Err(error) if is_of(&error, CHECK_STAGE) => (None, Some(chain(&error))),
        // The method cannot reconstruct these inputs, and the table shows it.
        Err(error @ RunError::Stage { .. }) if !is_of(&error, OUTPUT_STAGE) => (Some(chain(&error)), None),
        Err(error) => return Err(error.into()),
    };
    let cost = TrialCost { seconds: started.elapsed().as_secs_f64(), peak_mib: peak_mib() };
    let record = TrialRecord { fingerprint, cost, failed, rejected };
    let bytes = serde_json::to_vec_pretty(&record)
        .map_err(|e| TrialsError::Write { path: path.clone(), source: e.into() })?;
    put(&path, &bytes)?;
    Ok(record)
}

fn is_of(error: &RunError, name: &str) -> bool {
    matches!(error, RunError::Stage { stage, .. } if stage == name)
}

/// Folder of the twin of a trial.
fn result_folder(request: &ReconstructRequest, record: &TrialRecord) -> PathBuf {
    let name = request.name.as_deref().unwrap_or_default();
    let place = if record.rejected.is_some() { request.rejected_place(name) } else { request.place(name) };
    // An invalid name has no result.
    place.target().unwrap_or_default()
}

/// Writes a file, which appears when it is complete, and creates its folder.
fn put(path: &Path, bytes: &[u8]) -> Result<(), TrialsError> {
    let failed = |source| TrialsError::Write { path: path.to_owned(), source };
    path.parent().map_or(Ok(()), fs::create_dir_all).map_err(failed)?;
    files::write_whole(path, bytes).map_err(failed)
}

/// Resets the peak resident memory of this process. Other systems than Linux lack the file for it; then
/// nothing happens and nothing is reported.
fn forget_peak() {
    fs::write("/proc/self/clear_refs", "5").ok();
}

/// Peak resident memory of this process since the reset, MiB; `None` if the system does not count it.
fn peak_mib() -> Option<f64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.split_whitespace().next()?.parse().ok()?;
    Some(kib / 1024.0)
}
