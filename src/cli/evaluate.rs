//! `artitwin evaluate`.

use super::{
    args::EvaluateArgs,
    exit::{CliError, Exit},
    terminal,
};
use evaluate::{self, EvaluateOptions, PUBLISHED_MIN_COMPONENT};

/// Prints the metrics of runs.
///
/// # Errors
/// If a run or the truth cannot be read.
pub(super) fn print_metrics(args: &EvaluateArgs) -> Result<Exit, CliError> {
    // Off by default: stray components are errors of a twin and count as such.
    let min_component = args.filter_components.then_some(PUBLISHED_MIN_COMPONENT);
    let options = EvaluateOptions { samples: args.samples, seed: args.seed, min_component };
    let report = evaluate::evaluate_runs(&args.runs, &args.truth, &options)?;
    let text = if args.json { report.to_json() + "\n" } else { report.to_text() };
    terminal::print_result(&text)?;
    Ok(Exit::Done)
}
