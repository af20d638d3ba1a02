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
mod joint;
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
mod trace;
mod track;
mod trials;
mod wanted;

use std::process::ExitCode;

use clap::Parser as _;

use command::{Cli, Command};
use exit::{CliError, Exit};
use terminal::{ensure_written, print_line};

/// Parses the arguments, runs the command, gives its exit code.
#[must_use]
pub fn main() -> ExitCode {
    // Not `parse`: it would end the process by itself, with a code of its own.
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            let arguments: Vec<std::ffi::OsString> = std::env::args_os().collect();
            if error.kind() == clap::error::ErrorKind::InvalidSubcommand
                && let Some((program, rest)) = external::find_program(&arguments)
            {
                return exit_code_of(external::run_program(&program, rest));
            }
            if error.use_stderr() {
                error.print().ok();
                return Exit::Usage.into();
            }
            // Help and version are results.
            return exit_code_of(ensure_written(error.print()).map(|()| Exit::Done));
        }
    };
    exit_code_of(run_command(cli.command))
}

/// The exit code; an error is printed.
fn exit_code_of(outcome: Result<Exit, CliError>) -> ExitCode {
    let exit = outcome.unwrap_or_else(|error| {
        print_line(&format!("error: {}", error.chain()));
        error.exit()
    });
    exit.into()
}

fn run_command(command: Command) -> Result<Exit, CliError> {
    trace::start_trace();
    // Not in commands of days: the memory of a burst of messages would stay.
    if command.ends_by_itself() {
        memory::keep_freed();
    }
    match command {
        Command::Reconstruct(args) if args.estimate => estimate::print_reconstruct_estimate(&args),
        Command::Reconstruct(args) => reconstruct::run_reconstruct(&args),
        Command::Inspect(args) => inspect::print_contents(&args),
        Command::Track(args) => track::print_poses(&args),
        Command::Board(args) => board::write_board(&args),
        Command::Check(args) => check::print_findings(&args),
        Command::Evaluate(args) => evaluate::print_metrics(&args),
        Command::Trials(args) => trials::run_trials(&args),
        Command::Diagnose(args) if args.estimate => estimate::print_diagnose_estimate(&args),
        Command::Diagnose(args) => diagnose::run_diagnose(&args),
        Command::Joint(args) => joint::print_joint(&args),
        Command::Demo(args) => demo::run_demo(&args),
        Command::Synth(args) => synth::write_object(&args),
        #[cfg(feature = "node")]
        Command::Node(args) => node::run(&args),
        #[cfg(feature = "node")]
        Command::Record(args) => record::run(&args),
        Command::Config { command } => config::print_config(&command),
        Command::Gallery(args) => gallery::write_gallery(&args),
        Command::Completions(args) => shell::print_completions(&args),
        Command::Man(args) => shell::print_man_page(&args),
        Command::Doctor => doctor::print_machine(),
    }
}
