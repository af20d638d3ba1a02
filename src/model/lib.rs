//! The articulated model at the center of the program: reconstruction ends with it, and every export is a
//! function of it.
//!
//! ```
//! use model::validate;
//!
//! let cabinet = model::example::cabinet();
//! assert!(validate(&cabinet).is_empty());
//! assert_eq!(cabinet.joints.len(), 2);
//! ```

mod articulated;
mod builder;
mod deviation;
mod dynamics;
#[doc(hidden)]
pub mod example;
mod grasp;
mod grasp_space;
#[cfg(test)]
mod grasp_tests;
mod joint_family;
mod material;
mod names;
mod part_names;
mod remark;
mod seat;
mod sweep;
mod tree;
mod validate;

pub use articulated::{
    ArticulatedModel, AxisAlone, Grasp, Inertial, Joint, JointDynamics, JointEvidence, JointKind, Limit,
    LimitSource, Link, ParentScore, Seat,
};
pub use builder::{LimitPolicy, ModelConfig, MovingPart, build_model, link_name};
pub use deviation::Deviations;
pub use dynamics::{JointLoad, assumed_dynamics, joint_load};
pub use grasp::grasps_of_joint;
pub use joint_family::{JointFamily, TypeScores};
pub use material::Material;
pub use names::is_xml_text;
pub use names::{escape_lines, escape_xml, identifier, is_plain_name, script_json};
pub use part_names::{PartNames, renamed_model};
pub use remark::JointRemark;
pub use seat::seat_of_joint;
pub use sweep::{clear_paths, swept_interval};
pub use tree::{JointType, Mimic, Tree, TreeError, TreeJoint, TreeLink};
pub use validate::{impossible_inertia, inertia_excess, principal_moments, validate};
