//! What was recorded, and which of it is compared.

pub mod frames;
pub mod options;
pub mod pixels;
