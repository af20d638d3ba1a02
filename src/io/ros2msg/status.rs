//! The project's own messages, as `msg/` defines them.

use serde::{Deserialize, Serialize};

use super::Header;

/// `artitwin_msgs/msg/CollectionStatus`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CollectionStatus {
    /// When.
    pub header: Header,
    /// 0 idle, 1 collecting, 2 moving, 3 ready, 4 reconstructing, 5 done.
    pub phase: u8,
    /// State being collected, or collected last.
    pub state: u8,
    /// Kept in each state.
    pub keyframes: [u32; 2],
    /// Matched sets of images since the last reset.
    pub matched: u64,
    /// Images without partner, since the last reset.
    pub unmatched: u64,
    /// Folder of the recordings.
    pub session: String,
    /// Whether the camera is tracked by its images.
    pub tracked: bool,
    /// Placed by tracking.
    pub views_per_second: f32,
    /// Share of the surface that the last view and the map see alike; 0: lost.
    pub inliers: f32,
    /// Standard deviation of the last view's place, meters; infinite: lost.
    pub position_error: f32,
    /// Advice to the user; empty: go on.
    pub hint: String,
}
