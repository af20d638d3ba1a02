//! `artitwin config`.

use super::{
    command::ConfigCommand,
    exit::{CliError, Exit},
    terminal,
};

/// Prints the merged configuration.
///
/// # Errors
/// If it is wrong.
pub(super) fn run(command: &ConfigCommand) -> Result<Exit, CliError> {
    let ConfigCommand::Show { settings, origin } = command;
    let resolved = settings.resolve()?;
    terminal::print(&if *origin { resolved.to_lines_with_origins() } else { resolved.to_yaml()? })?;
    Ok(Exit::Done)
}
