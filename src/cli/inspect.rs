//! `artitwin inspect`.

use super::{
    args::InspectArgs,
    exit::{CliError, Exit},
    terminal,
};
use crate::io;

/// Prints what a recording holds; fails if `reconstruct` could not use it.
///
/// # Errors
/// If it cannot be read at all.
pub fn run(args: &InspectArgs) -> Result<Exit, CliError> {
    let found = io::inspect(&args.bag)?;
    terminal::print(&found.to_text())?;
    // A script can ask by the exit code.
    Ok(if found.is_usable() { Exit::Done } else { Exit::Failed })
}
