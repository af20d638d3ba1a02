//! `artitwin evaluate`.

use super::{
    args::EvaluateArgs,
    exit::{CliError, Exit},
    terminal,
};
use evaluate::{self, EvaluateOptions};

/// Prints the metrics of runs.
///
/// # Errors
/// If a run or the truth cannot be read.
pub(super) fn print_metrics(args: &EvaluateArgs) -> Result<Exit, CliError> {
    let report = evaluate::evaluate_runs(&args.runs, &args.truth, &EvaluateOptions::default())?;
    let text = if args.json { report.to_json() + "\n" } else { report.to_text() };
    terminal::print_result(&text)?;
    Ok(Exit::Done)
}
