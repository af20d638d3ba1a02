//! What a collector knows of views that are tracked.

use crate::live_tracking::ToTrack;

/// What is tracked.
#[derive(Default)]
pub(super) struct Tracking {
    /// Number of the map.
    pub map: u64,
    /// Whether views are tracked.
    pub is_on: bool,
    /// Whether the views kept of this state are; `None` without any.
    pub kept: Option<bool>,
    /// Views to be tracked.
    pub to_track: Vec<ToTrack>,
}
