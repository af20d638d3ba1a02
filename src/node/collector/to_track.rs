//! The collector's state for tracked views.

use crate::live_tracking::ToTrack;
use capture::TrackCamera;

/// The map of tracked views and the views to be tracked.
#[derive(Default)]
pub(super) struct TrackedMap {
    /// Number of the map.
    pub map: u64,
    /// Whether views are being tracked.
    pub is_on: bool,
    /// Whether the camera is tracked in the state being collected.
    pub in_state: TrackCamera,
    /// Whether the kept views of this state are tracked ones; `None` without any.
    pub kept: Option<bool>,
    /// Views to be tracked.
    pub to_track: Vec<ToTrack>,
}
