//! The joint behind recorded paths of its part, without a twin: type, axis, line, limits and positions.
//!
//! A path is that of a tag, a tracker or a gripper, as positions or as poses ([`trace`]). A slide draws a
//! line, a hinge a circle; a line is the circle without bend, so both are one [`curve`] with four and with
//! six parameters. What lies off the curve is not white noise: a tracker has systematic errors and a hand
//! slips. It is a process that wanders along the track ([`crate::wander`]), whose size, correlation and
//! outliers are found with the curve ([`fit`]). The type follows from the evidence for the bend ([`bend`]),
//! to which rotations add how much the part turns along its way ([`spin`]). Several openings make one joint
//! ([`repeats`]). See docs/method.md (14.20).

pub mod bend;
pub mod curve;
pub mod fit;
pub mod joint;
pub mod opening;
pub mod repeats;
pub mod spin;
pub mod start;
pub mod trace;

#[cfg(test)]
mod tests;
