//! The twin, errors of it and of the camera, and their motion of the surface.

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
