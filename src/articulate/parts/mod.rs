//! Selects the parts among the proposed motions, and their surface.

pub(crate) mod config;
pub(crate) mod difference;
pub(crate) mod division;
pub(crate) mod elimination;
pub(crate) mod end_for_end;
pub(crate) mod error;
pub(crate) mod evidence_curve;
pub(crate) mod exchange;
pub(crate) mod labeling;
pub(crate) mod matched_pair;
pub(crate) mod part_count;
pub(crate) mod register;
pub(crate) mod registrar;
pub(crate) mod round_parts;
pub(crate) mod score;
pub(crate) mod segment;
pub(crate) mod settle;
pub(crate) mod states;
pub(crate) mod step_field;
