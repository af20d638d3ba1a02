//! Conclusions from the fits: findings, verdict, proof, report.

pub mod assess;
pub mod conclude;
pub mod diagnosis;
pub mod effect_size;
pub mod finding;
mod follow;
pub mod laws;
pub mod missing_box;
pub mod missing_finding;
pub mod missing_geometry;
pub mod other_types;
pub mod proof;
pub mod report;
pub mod search;
pub mod select;
pub mod type_change;
pub mod weigh;
