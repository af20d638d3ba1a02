//! Proposes possible motions of parts: from matches, and from surface that was left or reached.

pub(crate) mod agreement;
pub(crate) mod patch;
pub(crate) mod ransac;
pub(crate) mod residual;
pub(crate) mod round_part;
pub(crate) mod search;
pub(crate) mod slid_panel;
pub(crate) mod trial;
