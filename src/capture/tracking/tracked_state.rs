//! A state whose camera was tracked.

use super::track::Track;
use crate::BoardSighting;
use common::note::Note;

/// The camera's way through a state.
pub struct TrackedState {
    /// The way of the views.
    pub track: Track,
    /// Views that were looked at, by their numbers among those of the recording.
    pub views: Vec<usize>,
    /// The board of tags that each of them shows.
    pub boards: Vec<Option<BoardSighting>>,
    /// What was found.
    pub notes: Vec<Note>,
    /// What was lost.
    pub warnings: Vec<Note>,
}
