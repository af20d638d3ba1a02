//! A state with a tracked camera.

use super::track::Track;
use crate::BoardSighting;
use common::note::Note;

/// A state with a tracked camera.
pub struct TrackedState {
    /// Trajectory of the views.
    pub track: Track,
    /// Indices in the recording of the tracked views.
    pub views: Vec<usize>,
    /// Per view, the tag board it shows.
    pub boards: Vec<Option<BoardSighting>>,
    /// Notes for the report.
    pub notes: Vec<Note>,
    /// Warnings for the report.
    pub warnings: Vec<Note>,
}
