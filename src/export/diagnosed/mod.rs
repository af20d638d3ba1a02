//! Files of a diagnosed twin: the given ones with the found effects.

mod edits;
pub mod mjcf;
pub mod numbers;
pub mod sdf;
pub mod seen_urdf;
mod tilt;
pub mod urdf;
pub mod usd;
