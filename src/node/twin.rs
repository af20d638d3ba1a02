//! The node's twin.

use io::RunSummary;

/// A finished twin, as it is published.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Twin {
    /// The summary of its run folder.
    pub summary: RunSummary,
    /// The shown observed state.
    pub state: usize,
    /// Its frame.
    pub world_frame: String,
}
