//! Numbers: random streams, robust statistics, numbered lists and sets, loops for vector instructions.
//!
//! ```
//! use numeric::{random::{standard_normal, stage_rng}, statistics::median};
//!
//! // The same draws in every run: a stream for each stage and step.
//! let mut rng = stage_rng(0, "noise", 3);
//! let draws = (0..1001).map(|_| standard_normal(&mut rng)).collect();
//! assert!(median(draws).is_some_and(|middle| middle.abs() < 0.1));
//! ```

pub mod index_sets;
pub mod lists;
pub mod random;
pub mod statistics;
pub mod vectors;
