//! Why a state cannot be begun, ended or read.

use super::session_lock::SessionLockError;
use io::BagWriteError;
use run::chain;

/// Why a state cannot be begun, ended or read.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CollectError {
    /// There are two states.
    #[error("there is no state {0}; give 0 or 1")]
    NoState(usize),
    /// One state at a time.
    #[error("state {0} is being collected; finish it first")]
    Collecting(usize),
    /// It was not begun.
    #[error("state {0} is not being collected; start it first")]
    NotCollecting(usize),
    /// Another one was begun.
    #[error("state {collecting} is being collected, not {asked}")]
    Other {
        /// The state in collection.
        collecting: usize,
        /// The state to end.
        asked: usize,
    },
    /// Nothing was kept.
    #[error("no view of state {state} was kept, so it does not count; {why}")]
    NoView {
        /// The state.
        state: usize,
        /// The missing part.
        why: String,
    },
    /// The recording was closed by an error.
    #[error("no recording is open")]
    NoRecording,
    /// The disk refuses.
    #[error(transparent)]
    Bag(#[from] BagWriteError),
    /// The next session cannot be worked on.
    #[error("{}", chain(.0))]
    Session(#[from] SessionLockError),
    /// A run reads the session.
    #[error("a reconstruction reads the session; wait for its end, or cancel it")]
    Read,
    /// Neither state was collected.
    #[error("states 0 and 1 have no views; collect them with start_state and finish_state")]
    NoStates,
    /// One state was not collected.
    #[error("state {0} has no views; collect it with start_state and finish_state")]
    Missing(u8),
    /// The node ends.
    #[error("the node is ending")]
    Ending,
}
