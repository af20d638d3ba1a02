//! The recorded frames and their compared pixels.

pub mod frames;
pub mod options;
pub mod pixels;
