//! Files of a diagnosed twin: the given files with the found effects added.

mod edits;
pub mod mjcf;
pub mod numbers;
pub mod sdf;
pub mod seen_urdf;
mod tilt;
pub mod urdf;
pub mod usd;
