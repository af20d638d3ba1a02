//! Metrics of a finished run against ground truth (docs/method.md 13), from its files for simulators.
//!
//! In addition to the published metrics there are plain ones: the joint type is read from the file and may be
//! wrong, parallel lines keep their distance, surfaces are measured in millimeters, and each Chamfer distance
//! comes with the floor due to sampling.
//!
//! ```no_run
//! use evaluate::{EvaluateOptions, evaluate_runs};
//!
//! let report = evaluate_runs(&["runs/drawer".into()], "bags/drawer".as_ref(), &EvaluateOptions::default())?;
//! println!("{:?}", report.trials[0].joints);
//! # Ok::<(), evaluate::EvaluateError>(())
//! ```

mod compare;
mod components;
mod error;
mod joint_metrics;
mod matching;
mod published;
mod published_truth;
mod report;
mod run_files;
mod surface_metrics;
mod trial_table;
mod truth;

use std::path::{Path, PathBuf};

pub use compare::{Evaluation, compare_run};
pub use error::{EvaluateError, MAX_SAMPLES};
pub use published::Published;
pub use report::EvaluationReport;
pub use run_files::RunFiles;
pub use trial_table::{TrialCost, TrialTable};
pub use truth::Truth;

/// Smallest component kept in the published evaluation, as a share of the largest.
/// derived: the published one
pub const PUBLISHED_MIN_COMPONENT: f64 = 0.1;

/// Options of an evaluation.
#[derive(Clone, Debug, PartialEq)]
pub struct EvaluateOptions {
    /// Samples per surface; published evaluations use 10,000.
    pub samples: usize,
    /// Seed of the samples.
    pub seed: u64,
    /// Drops components of the found meshes smaller than this share of the largest one's area, e.g.
    /// [`PUBLISHED_MIN_COMPONENT`].
    pub min_component: Option<f64>,
}

impl Default for EvaluateOptions {
    fn default() -> Self {
        Self { samples: 10_000, seed: 0, min_component: None }
    }
}

/// Reads the truth in a folder: a `truth.json`, or a published dataset's `trans.json`.
///
/// # Errors
/// If a file is missing or damaged; the error names it.
pub fn read_truth(folder: &Path) -> Result<Truth, EvaluateError> {
    match published_truth::find_transforms(folder).filter(|_| !folder.join("truth.json").exists()) {
        Some(path) => published_truth::read_transforms(&path),
        None => Truth::read(folder),
    }
}

/// Measures runs (trials) of one object against its truth: a folder with `truth.json` and `truth/state{0,1}`,
/// or a published dataset with its `trans.json`.
///
/// # Errors
/// If there is no run, or if a file of the truth, or of every run, is missing, damaged or beyond a limit; the
/// error names the file. Among several runs an unreadable one counts as a failed trial.
pub fn evaluate_runs(
    runs: &[PathBuf],
    truth: &Path,
    options: &EvaluateOptions,
) -> Result<EvaluationReport, EvaluateError> {
    if runs.is_empty() {
        return Err(EvaluateError::NoRun);
    }
    if !(1..=MAX_SAMPLES).contains(&options.samples) {
        return Err(EvaluateError::Samples(options.samples));
    }
    // Read once for all trials.
    let known = read_truth(truth)?;
    let measured = runs.iter().map(|folder| evaluate_run(folder, &known, options)).collect::<Vec<_>>();
    let trials = if measured.iter().any(Result::is_ok) {
        measured.into_iter().zip(runs).map(|(trial, folder)| or_failed(trial, folder, &known)).collect()
    } else {
        measured.into_iter().collect::<Result<Vec<_>, _>>()?
    };
    let published = Published::of_trials(&trials);
    let &EvaluateOptions { samples, seed, min_component } = options;
    Ok(EvaluationReport {
        truth: truth.display().to_string(),
        samples,
        seed,
        min_component,
        trials,
        published,
    })
}

/// Measures trials of one object; an unreadable run counts as a failed trial.
pub fn evaluate_trials(runs: &[PathBuf], truth: &Truth, options: &EvaluateOptions) -> Vec<Evaluation> {
    runs.iter().map(|folder| or_failed(evaluate_run(folder, truth, options), folder, truth)).collect()
}

/// Measures one run; only the numbers are kept in memory.
fn evaluate_run(
    folder: &Path,
    truth: &Truth,
    options: &EvaluateOptions,
) -> Result<Evaluation, EvaluateError> {
    let files = RunFiles::read(folder, options.min_component)?;
    compare_run(&folder.display().to_string(), truth, &files, options)
}

fn or_failed(trial: Result<Evaluation, EvaluateError>, folder: &Path, truth: &Truth) -> Evaluation {
    trial.unwrap_or_else(|error| Evaluation::failed(&folder.display().to_string(), truth, error.to_string()))
}
