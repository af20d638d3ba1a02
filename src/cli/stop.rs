//! Ctrl-C.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
    mpsc::Sender,
};

use super::exit::{CliError, Exit};
use common::note::NoteCode;
use run::Event;

/// Lets the first Ctrl-C (or SIGTERM) set the flag; the second ends the process.
pub(super) fn stop_on_request(events: Sender<Event>, stop: Arc<AtomicBool>) -> Result<(), CliError> {
    ctrlc::set_handler(move || {
        // A step may take long: a second request ends it.
        if stop.swap(true, Ordering::Relaxed) {
            std::process::exit(Exit::Cancelled as i32);
        }
        events
            .send(Event::Note {
                code: NoteCode::Stopping,
                message:
                    "stopping after this step; ask again to stop at once: finished stages are kept either way"
                        .to_owned(),
            })
            .ok();
    })?;
    Ok(())
}
