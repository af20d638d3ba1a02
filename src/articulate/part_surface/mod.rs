//! The surface of each part, from all states.

pub mod assemble;
pub mod contradicted;
pub mod label_grid;
