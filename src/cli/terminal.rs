//! Standard output and error: results, diagnostics, nothing that would steer a terminal.

use std::io::{self, Write as _};

use super::exit::CliError;
use ::io::printable;

/// Writes a result. A reader that went away is not an error.
pub(super) fn print(text: &str) -> Result<(), CliError> {
    written(io::stdout().write_all(lines(text).as_bytes()))
}

/// What became of writing to standard output, all the way: what is left in the buffer is written too.
pub(super) fn written(outcome: io::Result<()>) -> Result<(), CliError> {
    // A full disk shows only when the buffer is written; `head` ends before us, which is no failure.
    match outcome.and_then(|()| io::stdout().flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(CliError::Output(error)),
        _ => Ok(()),
    }
}

/// Writes a diagnostic line; there is nowhere to complain if that fails.
pub(super) fn print_line(line: &str) {
    writeln!(io::stderr(), "{}", lines(line)).ok();
}

/// Text without control characters but the ends of lines: names from files would steer the terminal.
fn lines(text: &str) -> String {
    text.split('\n').map(printable).collect::<Vec<_>>().join("\n")
}
