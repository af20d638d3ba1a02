//! `artitwin check`.

use super::{
    args::CheckArgs,
    exit::{CliError, Exit},
    terminal,
};
use export::{Level, check_folder};

/// Checks a folder or a file: one line a finding, then a line with their counts.
///
/// # Errors
/// The model cannot be read.
pub(super) fn print_findings(args: &CheckArgs) -> Result<Exit, CliError> {
    let found = check_folder(&io::read_model(&args.model)?);
    let errors = found.iter().filter(|f| f.level == Level::Error).count();
    let mut text: String = found.iter().map(|f| format!("{f}\n")).collect();
    text.push_str(&format!("{errors} errors, {} warnings\n", found.len() - errors));
    terminal::print_result(&text)?;
    // A warning is a different reading by some importer; with --strict all of them count.
    let failed = errors > 0 || (args.strict && !found.is_empty());
    Ok(if failed { Exit::Failed } else { Exit::Done })
}
