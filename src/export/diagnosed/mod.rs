//! Files of a diagnosed twin: the given files with the found effects added.

mod edits;
pub mod effects;
pub mod mjcf;
pub mod numbers;
mod sdf;
pub mod seen_urdf;
pub mod tilt;
pub mod urdf;
mod usd;
