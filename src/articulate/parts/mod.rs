//! Which motions are parts, and which surface follows which.

pub mod config;
pub mod difference;
pub mod division;
pub mod elimination;
pub mod end_for_end;
pub mod error;
pub mod evidence_curve;
pub mod exchange;
pub mod labeling;
pub mod matched_pair;
pub mod part_count;
pub mod register;
pub mod registrar;
pub mod round_parts;
pub mod score;
pub mod segment;
pub mod settle;
pub mod states;
pub mod step_field;
