//! `artitwin completions` and `artitwin man`: descriptions of the commands for a shell and for `man`.

use std::io::{self, Write as _};

use clap::CommandFactory as _;

use super::{
    command::{Cli, CompletionsArgs, ManArgs},
    exit::{CliError, Exit},
    terminal::ensure_written,
};

/// Prints the completions of a shell.
///
/// # Errors
/// The output cannot be written.
pub(super) fn print_completions(args: &CompletionsArgs) -> Result<Exit, CliError> {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "artitwin", &mut text);
    ensure_written(io::stdout().write_all(&text)).map(|()| Exit::Done)
}

/// Prints a manual page (roff).
///
/// # Errors
/// An unknown command; the output cannot be written.
pub(super) fn print_man_page(args: &ManArgs) -> Result<Exit, CliError> {
    let mut all = Cli::command();
    all.build();
    let page = match &args.command {
        None => all,
        Some(name) => all.find_subcommand(name).ok_or(CliError::Usage("there is no such command"))?.clone(),
    };
    let mut text = Vec::new();
    ensure_written(clap_mangen::Man::new(page).render(&mut text))?;
    ensure_written(io::stdout().write_all(&text)).map(|()| Exit::Done)
}
