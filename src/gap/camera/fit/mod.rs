//! Residuals of the posed twin, and the mixed model weighing parameters against unnamed errors.

pub mod components;
pub mod cost;
pub mod linear;
pub mod mixed;
pub mod patches;
pub mod placement;
pub mod predict;
pub mod problem;
pub mod reduced;
pub mod residual;
pub mod sample;
