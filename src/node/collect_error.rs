//! Errors of collecting states.

use super::session_lock::SessionLockError;
use io::BagWriteError;
use run::chain;

/// Why a state cannot be started, finished or read.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CollectError {
    /// No such state; there are two.
    #[error("there is no state {0}; give 0 or 1")]
    NoState(usize),
    /// Another state is being collected.
    #[error("state {0} is being collected; finish it first")]
    Collecting(usize),
    /// The state was not started.
    #[error("state {0} is not being collected; start it first")]
    NotCollecting(usize),
    /// Another state is being collected than the one to finish.
    #[error("state {collecting} is being collected, not {asked}")]
    Other {
        /// State being collected.
        collecting: usize,
        /// State that was to be finished.
        asked: usize,
    },
    /// No view was kept.
    #[error("no view of state {state} was kept, so it does not count; {why}")]
    NoView {
        /// Index of the state.
        state: usize,
        /// What was missing.
        why: String,
    },
    /// An error closed the recording.
    #[error("no recording is open")]
    NoRecording,
    /// Writing to the disk failed.
    #[error(transparent)]
    Bag(#[from] BagWriteError),
    /// The folder of the next session is not available.
    #[error("{}", chain(.0))]
    Session(#[from] SessionLockError),
    /// A reconstruction is reading the session.
    #[error("a reconstruction reads the session; wait for its end, or cancel it")]
    Read,
    /// Neither state was collected.
    #[error("states 0 and 1 have no views; collect them with start_state and finish_state")]
    NoStates,
    /// One state was not collected.
    #[error("state {0} has no views; collect it with start_state and finish_state")]
    Missing(u8),
    /// The node is shutting down.
    #[error("the node is ending")]
    Ending,
}
