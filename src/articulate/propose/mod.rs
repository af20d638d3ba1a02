//! Motions that parts may have made: by matches, and by surface that was left or reached.

pub mod agreement;
pub mod patch;
pub mod ransac;
pub mod residual;
pub mod round_part;
pub mod search;
pub mod slid_panel;
pub mod trial;
