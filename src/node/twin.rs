//! The twin that the node has.

use io::RunSummary;

/// A finished twin, as it is published.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Twin {
    /// What its run folder says.
    pub summary: RunSummary,
    /// The observed state that is shown.
    pub state: usize,
    /// Frame in which it stands.
    pub world_frame: String,
}
