//! Standard output and error: results, diagnostics, no control characters.

use std::io::{self, Write as _};

use super::exit::CliError;
use ::io::printable;

/// Writes a result. A closed pipe is not an error.
pub(super) fn print_result(text: &str) -> Result<(), CliError> {
    ensure_written(io::stdout().write_all(printable_lines(text).as_bytes()))
}

/// The outcome of writing to standard output, with the rest of the buffer written, too.
pub(super) fn ensure_written(outcome: io::Result<()>) -> Result<(), CliError> {
    // A full disk shows only when the buffer is written; `head` ends before us: no failure.
    match outcome.and_then(|()| io::stdout().flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(CliError::Output(error)),
        _ => Ok(()),
    }
}

/// Writes a diagnostic line; a failure has no place to be reported.
pub(super) fn print_line(line: &str) {
    writeln!(io::stderr(), "{}", printable_lines(line)).ok();
}

/// Text without control characters but the ends of lines: names from files would steer the terminal.
fn printable_lines(text: &str) -> String {
    text.split('\n').map(printable).collect::<Vec<_>>().join("\n")
}
