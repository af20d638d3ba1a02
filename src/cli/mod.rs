//! The terminal: arguments, progress, exit codes. Results go to stdout, everything else to stderr.

mod actuator_args;
mod args;
mod board;
mod check;
mod command;
mod config;
mod demo;
mod diagnose;
mod doctor;
mod estimate;
mod evaluate;
mod exit;
mod external;
mod gallery;
mod inspect;
mod machine;
mod memory;
#[cfg(feature = "node")]
mod node;
mod progress;
mod reconstruct;
#[cfg(feature = "node")]
mod record;
mod recording_args;
mod render;
mod settings;
mod shell;
mod stop;
mod synth;
mod terminal;
mod track;
mod trials;
mod wanted;

use std::process::ExitCode;

use clap::Parser as _;

use command::{Cli, Command};
use exit::{CliError, Exit};
use terminal::{print_line, written};

/// Parses the arguments, runs the command, gives its exit code.
#[must_use]
pub fn main() -> ExitCode {
    // Not `parse`: it would end the process by itself, with a code of its own.
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            let arguments: Vec<std::ffi::OsString> = std::env::args_os().collect();
            if error.kind() == clap::error::ErrorKind::InvalidSubcommand
                && let Some((program, rest)) = external::find(&arguments)
            {
                return ended(external::run(&program, rest));
            }
            if error.use_stderr() {
                error.print().ok();
                return Exit::Usage.into();
            }
            // Help and version are results.
            return ended(written(error.print()).map(|()| Exit::Done));
        }
    };
    ended(run(cli.command))
}

/// The exit code; an error is printed.
fn ended(outcome: Result<Exit, CliError>) -> ExitCode {
    let exit = outcome.unwrap_or_else(|error| {
        print_line(&format!("error: {}", error.chain()));
        error.exit()
    });
    exit.into()
}

fn run(command: Command) -> Result<Exit, CliError> {
    // Not in commands of days: the memory of a burst of messages would stay.
    if command.ends_by_itself() {
        memory::keep_freed();
    }
    match command {
        Command::Reconstruct(args) if args.estimate => estimate::reconstruct(&args),
        Command::Reconstruct(args) => reconstruct::run(&args),
        Command::Inspect(args) => inspect::run(&args),
        Command::Track(args) => track::run(&args),
        Command::Board(args) => board::run(&args),
        Command::Check(args) => check::run(&args),
        Command::Evaluate(args) => evaluate::run(&args),
        Command::Trials(args) => trials::run(&args),
        Command::Diagnose(args) if args.estimate => estimate::diagnose(&args),
        Command::Diagnose(args) => diagnose::run(&args),
        Command::Demo(args) => demo::run(&args),
        Command::Synth(args) => synth::run(&args),
        #[cfg(feature = "node")]
        Command::Node(args) => node::run(&args),
        #[cfg(feature = "node")]
        Command::Record(args) => record::run(&args),
        Command::Config { command } => config::run(&command),
        Command::Gallery(args) => gallery::run(&args),
        Command::Completions(args) => shell::completions(&args),
        Command::Man(args) => shell::man(&args),
        Command::Doctor(settings) => doctor::run(&settings),
    }
}
