//! What a joint is taken to be: the twin's joint, effects beside it, and what file formats hold of them.

pub mod actuator;
pub mod bump;
pub mod effect;
pub mod effects;
pub mod expressed;
pub mod format;
pub mod joint_model;
pub mod plant;
