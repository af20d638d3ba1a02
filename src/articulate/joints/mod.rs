//! The joint that made the motions of a part, and the tree of joints.

pub(crate) mod axis_prior;
pub(crate) mod cautions;
pub(crate) mod estimate;
pub(crate) mod flat_faces;
pub(crate) mod free_motion;
pub(crate) mod gray_frames;
pub(crate) mod joint;
pub(crate) mod joint_config;
pub(crate) mod joint_covariance;
pub(crate) mod joint_fit;
pub(crate) mod joint_motion;
pub(crate) mod joint_type;
pub(crate) mod kinematic_tree;
pub(crate) mod match_evidence;
pub(crate) mod minimise;
pub(crate) mod motion_evidence;
pub(crate) mod pair_evidence;
pub(crate) mod parent_candidates;
pub(crate) mod part_evidence;
pub(crate) mod patch_alignment;
pub(crate) mod quadratic;
pub(crate) mod square_axes;
pub(crate) mod static_motion;
pub(crate) mod surface_error;
pub(crate) mod symmetry;
pub(crate) mod texture;
