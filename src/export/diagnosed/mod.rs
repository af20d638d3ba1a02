//! Files of a diagnosed twin: what was given, with the effects that were found.

mod edits;
pub mod mjcf;
pub mod numbers;
pub mod sdf;
pub mod seen_urdf;
mod tilt;
pub mod urdf;
pub mod usd;
