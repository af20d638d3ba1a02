//! A printed board of tags in view: it gives a recording scale, world and up. See docs/method.md 2.15.
//!
//! Tags are read by a detector (AprilTag 36h11); their edges are then measured to hundredths of a pixel, and
//! the camera's pose puts the edges of all tags on the measured ones, with one unknown for the spread of ink.
//! Many views together give the place of a tracked map on the board, and its length.

mod depth;
mod detection;
mod edges;
mod gray;
mod in_world;
mod layout;
mod place;
mod pose;
mod sighting;
mod start;
mod tag;
#[cfg(test)]
mod test_view;

use serde::{Deserialize, Serialize};

pub use self::{
    in_world::BoardInWorld,
    layout::{BoardLayout, Paper},
    place::{BoardInView, BoardPlace, ColorTurn, UNREAD_BOARD, board_scale, pose_scaled},
    sighting::{BoardSighting, find_board},
};

/// Whether a board of tags is looked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum UseBoard {
    /// Where the camera is tracked by what it sees.
    #[default]
    Auto,
    /// A board is a thing like any other.
    Never,
}
