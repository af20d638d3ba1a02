//! The twin, errors of it and of the camera, and the surface displacements they cause.

pub mod advance;
pub mod displacement;
pub mod hypothesis;
pub mod missing;
pub mod own_error;
pub mod parameter;
pub mod posed;
pub mod scales;
pub mod small_motion;
pub mod tree;
pub mod trial;
pub mod twin;
