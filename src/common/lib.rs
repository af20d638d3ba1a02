//! Common to all layers: notes beside results, size limits for inputs, files named by a user, the facts on
//! which results depend, and a flag that stops long work.
//!
//! ```
//! use common::note::{Note, NoteCode};
//!
//! let note = Note::new(NoteCode::PosesMissing, "3 of 40 images have no pose").about("state 1");
//! assert_eq!(note.code.word(), "poses_missing");
//! assert_eq!(note.to_string(), "state 1: 3 of 40 images have no pose");
//! ```

pub mod ahead;
pub mod files;
pub mod fingerprint;
pub mod limits;
pub mod note;
pub mod stop;
