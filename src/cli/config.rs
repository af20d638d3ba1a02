//! `artitwin config`.

use super::{
    args::ConfigCommand,
    exit::{CliError, Exit},
};

/// Prints the merged configuration.
///
/// # Errors
/// If it is wrong.
pub fn run(command: &ConfigCommand) -> Result<Exit, CliError> {
    let ConfigCommand::Show { settings, origin } = command;
    let resolved = settings.resolve()?;
    super::print(&if *origin { resolved.to_lines_with_origins() } else { resolved.to_yaml()? })?;
    Ok(Exit::Done)
}
