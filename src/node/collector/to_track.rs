//! A collector's data about tracked views.

use crate::live_tracking::ToTrack;

/// The map of tracked views, and those on the way to it.
#[derive(Default)]
pub(super) struct TrackedMap {
    /// Number of the map.
    pub map: u64,
    /// Whether views are tracked.
    pub is_on: bool,
    /// Whether the views kept of this state are; `None` without any.
    pub kept: Option<bool>,
    /// Views to be tracked.
    pub to_track: Vec<ToTrack>,
}
