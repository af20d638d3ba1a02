//! The model of a joint: the twin's joint, added effects, and their expression in file formats.

pub mod actuator;
pub mod bump;
pub mod effect;
pub mod effects;
pub mod expressed;
pub mod format;
pub mod joint_model;
pub mod plant;
