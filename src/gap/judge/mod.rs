//! Names effects: screening, search, verdict, proof on held-out runs, report.

pub mod assess;
pub mod breadth;
pub mod columns;
pub mod convention;
pub mod cross_validation;
pub mod doubt;
pub mod doubt_json;
#[cfg(test)]
mod doubt_tests;
pub mod doubt_words;
pub mod exchange;
pub mod finding;
pub mod format_model;
#[cfg(test)]
mod format_model_tests;
pub mod format_note;
pub mod given;
pub mod idle;
pub mod imposed;
pub mod law;
#[cfg(test)]
mod law_tests;
pub mod locate;
pub mod multibody;
pub mod name_weight;
#[cfg(test)]
mod new_effect_tests;
pub mod observed;
pub mod offset;
#[cfg(test)]
mod one_way_damping;
pub mod orthogonal;
pub mod proof;
pub mod refined;
pub mod refused;
pub mod regression;
#[cfg(test)]
mod remainder_tests;
pub mod report;
pub mod report_json;
pub mod sampled;
pub mod screen;
pub mod search;
#[cfg(test)]
mod servo_tests;
pub mod simplify;
#[cfg(test)]
pub(super) mod simulated;
pub mod spread;
pub mod sure;
pub mod unsigned;
pub mod verdict;
