//! Articulation: matches between the states, rigid motions, part segmentation, joints (docs/method.md 6,
//! docs/method.md 8).
//!
//! ```
//! use articulate::published_joint;
//! use geometry::Pose;
//! use nalgebra::{Point3, Vector3};
//!
//! // A part moved by 20 cm without turning: it hangs on a slide.
//! let motion = Pose::new(Vector3::new(0.0, 0.2, 0.0), Vector3::zeros());
//! let joint = published_joint(&motion, &Point3::origin()).joint;
//! assert_eq!(joint.kind.name(), "prismatic");
//! assert!((joint.positions[0] - 0.2).abs() < 1e-12);
//! ```

mod joints;
mod matches;
mod neural;
mod observations;
mod pair;
mod part_surface;
mod parts;
mod propose;
mod samples;
mod world;

pub use joints::free_motion::ParentMotion;
pub use joints::joint::JointEstimate;
pub use joints::joint_config::{JointConfig, JointInference};
pub use joints::kinematic_tree::{TreeJointEstimate, kinematic_tree};
#[cfg(test)]
pub use joints::motion_evidence::MatchEvidence;
#[cfg(test)]
pub use joints::motion_evidence::MotionEvidence;
pub use joints::pair_evidence::{JOINT_REACH, ObservedState, PairEvidence};
pub use joints::part_evidence::PartEvidence;
pub use joints::published_joint::published_joint;
#[cfg(test)]
pub use joints::square_axes::SeenDirection;
pub use joints::static_motion::static_motion;
pub use joints::surface_draws::SurfaceDraws;
pub use matches::lift::lifted_matches;
#[cfg(feature = "onnx")]
pub use matches::model_image::{ImageFormat, ModelImage};
pub use neural::config::ArticulationConfig;
pub use neural::optimise::{ArticulationProblem, ArticulationStart, ArticulationTrainer};
pub use neural::state_model::{StateModel, SurfaceRay};
pub use neural::trainer_error::TrainerError;
pub use observations::{LiftedMatch, SurfaceSamples};
pub use pair::surface_pair::FreeSpace;
pub use part_surface::assemble::{LabelledState, NO_LABEL, part_tsdf};
pub use part_surface::contradicted::{OtherState, contradicted_points};
pub use part_surface::label_grid::label_grid;
pub use parts::config::{RegisterConfig, RegisterMethod};
pub use parts::difference::register_by_difference;
pub use parts::error::RegisterError;
pub use parts::evidence_curve::EvidencePoint;
pub use parts::register::Registration;
pub use parts::registrar::Registrar;
#[cfg(test)]
pub use parts::registrar::register;
pub use parts::score::LEAST_SCORE;
pub use parts::states::{StatePair, United, unite};
pub use samples::mesh_samples::mesh_samples;
pub use world::standing::{StandingShares, is_surface_seen_at, standing_shares};
pub use world::state_alignment::{AlignedBy, AlignmentError, StateAlignment, align_states};
