//! Numbers: lists in one piece of memory, streams of random numbers, robust statistics, loops for vector units.

pub mod lists;
pub mod random;
pub mod statistics;
pub mod vectors;
