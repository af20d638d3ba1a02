//! Turns recorded runs into positions and efforts of single joints.

pub mod carried;
pub mod chain;
#[cfg(test)]
mod chain_tests;
pub mod coarser;
pub mod command;
pub mod drive;
pub mod inputs;
pub mod jitter;
pub mod log;
pub mod motion;
pub mod off_axis;
pub mod reading_noise;
pub mod recording;
pub mod standing;
pub mod tracks;
pub mod wrapped;
