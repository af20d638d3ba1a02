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
pub(super) fn print_config(command: &ConfigCommand) -> Result<Exit, CliError> {
    let ConfigCommand::Show { settings, origin } = command;
    let resolved = settings.resolved_config()?;
    terminal::print_result(&if *origin { resolved.to_lines_with_origins() } else { resolved.to_yaml()? })?;
    Ok(Exit::Done)
}
