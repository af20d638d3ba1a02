//! What all layers share: notes beside results, limits on sizes that come from outside, files that a user
//! names, work that is asked to stop.
//!
//! ```ignore
//! use common::note::{Note, NoteCode};
//!
//! let note = Note::new(NoteCode::PosesMissing, "3 of 40 images have no pose").about("state 1");
//! assert_eq!(note.code.word(), "poses_missing");
//! assert_eq!(note.to_string(), "state 1: 3 of 40 images have no pose");
//! ```

pub mod files;
pub mod limits;
pub mod note;
pub mod stop;
