//! A printed board of tags in view: it gives a recording scale, world and up. See docs/method.md 2.15.
//!
//! A detector reads the tags (AprilTag 36h11), and their edges are then measured to hundredths of a pixel.
//! The camera pose is fitted to the edges of all tags, with one more unknown for the spread of ink. Many such
//! views determine the pose and the scale of a tracked map on the board.

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

/// Whether a tag board is looked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum UseBoard {
    /// Where the camera is tracked by its images.
    #[default]
    Auto,
    /// Boards are ignored.
    Never,
}
