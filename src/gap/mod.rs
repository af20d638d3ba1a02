//! The gap between a twin and measured motion: where they disagree, which effect is missing, and how much it closes.

pub mod assess;
pub mod camera;
pub mod chain;
#[cfg(test)]
mod chain_tests;
#[cfg(test)]
mod derivative_tests;
pub mod drive;
mod edits;
pub mod effect;
pub mod effects;
pub mod expressed;
pub mod fit;
pub mod held;
pub mod inputs;
pub mod joint_model;
pub mod locate;
pub mod log;
pub mod mjcf;
pub mod motion;
pub mod noise;
pub mod off_axis;
pub mod plant;
pub mod problem;
pub mod proof;
pub mod recording;
pub mod report;
pub mod rollout;
pub mod screen;
pub mod sdf;
pub mod search;
pub mod simplify;
pub mod smooth;
pub mod starts;
pub mod tilt;
pub mod tracks;
pub mod trig;
pub mod twin_tree;
pub mod update;
pub mod usd;
pub mod verdict;
pub mod whiten;
