//! The articulated model: the waist of the program. Reconstruction ends in it; every export is a function of it.

mod articulated;
mod build;
#[cfg(test)]
pub(crate) mod example;
mod tree;
mod validate;

pub use articulated::{ArticulatedModel, Inertial, Joint, JointEvidence, JointKind, Limit, LimitSource, Link};
pub use build::{ModelConfig, MovingPart, build};
pub use tree::{JointType, Mimic, Tree, TreeError, TreeJoint, TreeLink};
pub use validate::{Finding, is_plain_name, validate};
