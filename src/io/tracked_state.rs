//! A state whose camera was tracked, and where its map lies in the world.

use std::fs;

use super::bag::Bag;
use capture::{BoardInWorld, BoardSighting, CaptureConfig, CaptureError, Track, Unaligned};
use common::fingerprint::{Fingerprint, Key};
use common::note::Note;
use geometry::Pose;

/// The camera's way through a state.
pub(super) struct TrackedState {
    pub track: Track,
    /// Views that were looked at, by their numbers among those of the bag.
    pub views: Vec<usize>,
    /// The board of tags that each of them shows.
    pub boards: Vec<Option<BoardSighting>>,
    /// What was found.
    pub notes: Vec<Note>,
    /// What was lost.
    pub warnings: Vec<Note>,
}

impl TrackedState {
    /// Key of the camera's way through a state, of a bag as it is now; `None` where a file is gone.
    pub fn key(bag: &Bag, config: &CaptureConfig, (state, seed): (usize, u64)) -> Option<Key> {
        let mut facts = Fingerprint::default().with("seed", seed).with_settings("capture", config).ok()?;
        for path in &bag.files {
            let metadata = fs::metadata(path).ok()?;
            let changed = metadata.modified().ok()?;
            let file = format!("file {}", path.display());
            facts = facts.with(file, format!("{} bytes, {changed:?}", metadata.len()));
        }
        Some(facts.key(&format!("track/state{state}")))
    }
}

/// Where the maps of states lie in the world in which the twin stands.
pub(super) struct Worlds {
    /// From every state's map at its length in the world.
    pub from_maps: Vec<Pose>,
    /// Lengths in the world over those of the maps, and over those of depth.
    pub scale: f64,
    /// The board that the world is of.
    pub board: Option<BoardInWorld>,
}

impl Worlds {
    /// At the lengths of depth, and of no board.
    pub fn of_maps(from_maps: Vec<Pose>) -> Self {
        Self { from_maps, scale: 1.0, board: None }
    }
}

/// The error of a state that what stands still does not bring into the world.
pub(super) fn unaligned(state: usize, why: &Unaligned) -> CaptureError {
    let reason = match why {
        Unaligned::NothingAlike => "nothing looks alike in both".to_owned(),
        Unaligned::Ambiguous { cells: [best, next] } => {
            format!("two motions explain about as much of what looks alike ({best} and {next} places)")
        }
    };
    CaptureError::StatesUnaligned { state, reason }
}
