//! Decides whether the states were recorded in one world frame.

pub(crate) mod standing;
pub(crate) mod state_alignment;
