//! Image features of frames and their matches.

mod descriptor;
mod feature;
mod known;
mod luma;
mod matcher;
mod partner;
mod pixel_match;
mod scale_space;

pub(super) use feature::Feature;
pub use known::look_at;
pub(crate) use known::whole_image_features;
pub use luma::luma;
pub use matcher::{Correspondence, MatchConfig, frame_pairs, match_states, on_object};
pub(super) use partner::mutual_matches;
pub use pixel_match::PixelMatch;
