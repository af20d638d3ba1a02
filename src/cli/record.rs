//! `artitwin record`.

use super::{
    args::RecordArgs,
    exit::{CliError, Exit},
    terminal,
};

/// Records until it is asked to end; prints the number of messages.
///
/// # Errors
/// If the recorder cannot start or the disk refuses.
pub(super) fn run(args: &RecordArgs) -> Result<Exit, CliError> {
    let recorded = node::record(&args.bag, &args.arguments)?;
    terminal::print_result(&format!("{}: {} messages\n", args.bag.display(), recorded.messages))?;
    if recorded.dropped > 0 {
        terminal::print_line(&format!("warning: {} messages were lost or dropped", recorded.dropped));
    }
    // The bag is whole, but lacks messages: done, but degraded.
    Ok(if recorded.dropped > 0 { Exit::Degraded } else { Exit::Done })
}
