//! The terminal: arguments, progress, exit codes. Results go to stdout, everything else to stderr.

mod args;
mod check;
mod config;
mod diagnose;
mod doctor;
mod evaluate;
mod exit;
mod inspect;
mod machine;
#[cfg(feature = "node")]
mod node;
mod progress;
mod reconstruct;
#[cfg(feature = "node")]
mod record;
mod render;
mod settings;
mod synth;

use std::{
    io::{self, Write as _},
    process::ExitCode,
};

use clap::Parser as _;

use args::{Cli, Command};
use exit::{CliError, Exit};

/// Parses the arguments, runs the command, gives its exit code.
#[must_use]
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version are results; only a broken pipe can stop them.
            error.print().ok();
            return if error.use_stderr() { Exit::Usage } else { Exit::Done }.into();
        }
    };
    match run(cli.command) {
        Ok(exit) => exit.into(),
        Err(error) => {
            let exit = error.exit();
            tell(&format!("error: {}", error.chain()));
            exit.into()
        }
    }
}

fn run(command: Command) -> Result<Exit, CliError> {
    match command {
        Command::Reconstruct(args) => reconstruct::run(&args),
        Command::Inspect(args) => inspect::run(&args),
        Command::Check(args) => check::run(&args),
        Command::Evaluate(args) => evaluate::run(&args),
        Command::Diagnose(args) => diagnose::run(&args),
        Command::Synth(args) => synth::run(&args),
        #[cfg(feature = "node")]
        Command::Node(args) => node::run(&args),
        #[cfg(feature = "node")]
        Command::Record(args) => record::run(&args),
        Command::Config { command } => config::run(&command),
        Command::Doctor(settings) => doctor::run(&settings),
    }
}

/// Writes a result. A reader that went away is not an error.
fn print(text: &str) -> Result<(), CliError> {
    match io::stdout().write_all(lines(text).as_bytes()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(CliError::Output(error)),
        _ => Ok(()),
    }
}

/// Writes a diagnostic line; there is nowhere to complain if that fails.
fn tell(line: &str) {
    writeln!(io::stderr(), "{}", lines(line)).ok();
}

/// Text without control characters but the ends of lines: names from files would steer the terminal.
fn lines(text: &str) -> String {
    text.split('\n').map(crate::io::printable).collect::<Vec<_>>().join("\n")
}
