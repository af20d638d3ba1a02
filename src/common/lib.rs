//! What all layers share: notes beside results, limits on sizes that come from outside, files that a user names.

pub mod files;
pub mod limits;
pub mod note;
#[doc(hidden)]
pub mod temp;
