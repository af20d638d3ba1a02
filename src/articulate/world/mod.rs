//! Whether the states were recorded in one world frame.

pub mod standing;
pub mod state_alignment;
