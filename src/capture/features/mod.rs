//! Image features of frames, and which of two frames show the same.

mod descriptor;
mod feature;
mod known;
mod luma;
mod matcher;
mod pixel_match;
mod scale_space;

pub(super) use feature::Feature;
pub use known::KnownFeatures;
pub(crate) use luma::luma;
pub(super) use matcher::mutual_matches;
pub use matcher::{Correspondence, MatchConfig, frame_pairs, match_states, on_object};
pub use pixel_match::PixelMatch;
