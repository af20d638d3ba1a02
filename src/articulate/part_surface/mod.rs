//! The surface of each part, from all states.

pub(crate) mod assemble;
pub(crate) mod contradicted;
pub(crate) mod label_grid;
