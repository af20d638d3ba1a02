//! The project's own messages, as `msg/` defines them.

use serde::{Deserialize, Serialize};

use super::Header;

/// `artitwin_msgs/msg/CollectionStatus`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CollectionStatus {
    /// Stamp of the status.
    pub header: Header,
    /// 0 idle, 1 collecting, 2 moving, 3 ready, 4 reconstructing, 5 done.
    pub phase: u8,
    /// State being collected, or collected last.
    pub state: u8,
    /// Number of keyframes kept in each state.
    pub keyframes: [u32; 2],
    /// Matched sets of images since the last reset.
    pub matched: u64,
    /// Images without partner, since the last reset.
    pub unmatched: u64,
    /// Folder of the recordings.
    pub session: String,
    /// Whether the camera is tracked by its images.
    pub tracked: bool,
    /// Number of views per second that tracking places.
    pub views_per_second: f32,
    /// Share of the surface on which the last view and the map agree; 0 if tracking is lost.
    pub inliers: f32,
    /// Standard deviation of the last view's position, meters; infinite if tracking is lost.
    pub position_error: f32,
    /// Advice to the user; empty if all is well.
    pub hint: String,
}
