//! The node's twin.

use io::RunSummary;

/// A reconstructed twin, as published.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Twin {
    /// Summary of its run folder.
    pub summary: RunSummary,
    /// Index of the observed state to show.
    pub state: usize,
    /// World frame of the twin.
    pub world_frame: String,
}
