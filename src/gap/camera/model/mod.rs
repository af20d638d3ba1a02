//! The twin, what may be wrong with it or with the camera, and how that moves what is seen.

pub mod advance;
pub mod displacement;
pub mod hypothesis;
pub mod interval;
pub mod missing;
pub mod own_error;
pub mod parameter;
pub mod posed;
pub mod scales;
pub mod small_motion;
pub mod tree;
pub mod trial;
pub mod twin;
