//! Options of commands that may run as jobs: inputs and outputs in stores.

use std::path::PathBuf;

use clap::Args;

/// How a job is done.
#[derive(Args, Clone, Debug, Default)]
#[command(next_help_heading = "Stores")]
pub struct JobArgs {
    /// Print what the command will need, as one line of JSON: cores, memory, scratch space, seconds, bytes
    /// that are stored and read; whether it was done. Nothing is run or written
    #[arg(long)]
    pub estimate: bool,
    /// Folder for what is fetched from a store and kept on the way to one; default: the system's folder for
    /// temporary files
    #[arg(long, value_name = "DIR")]
    pub scratch: Option<PathBuf>,
}
