//! Articulation: matches between the states, rigid motions, part segmentation, joints (method.md 4 and 5).

mod assemble;
mod axis_prior;
mod division;
mod evidence;
mod flat_faces;
mod hinge;
mod index_sets;
mod joint;
mod joint_motion;
mod joint_states;
mod kinematic_tree;
mod labels;
mod match_evidence;
mod motion_fit;
mod part_count;
mod parts;
mod square_axes;
mod texture;

pub use assemble::{LabelledState, NO_LABEL, part_tsdf};
pub use evidence::{ColorField, ColorSample, LiftedMatch, SurfaceSamples};
pub use joint::{JointEstimate, ParentMotion, estimate_joint, free_motion};
pub use joint_motion::{Carried, PrismaticMotion, RevoluteMotion, ScrewMotion};
pub use joint_states::{JointMotion, estimate_shared_joint};
pub use kinematic_tree::{TreeJointEstimate, kinematic_tree};
pub use labels::label_grid;
pub use match_evidence::match_evidence;
pub use motion_fit::{FreeMotion, MatchEvidence, MotionEvidence, MotionModel, RefineConfig, Refined, refine};
pub use part_count::EvidencePoint;
pub use parts::{JointConfig, ObservedState, PartEvidence, joint_of_part, pair_of, select};
pub use square_axes::{SeenDirection, SquareConfig, square_priors};
pub use texture::{TextureConfig, texture_matches};
mod descriptor;
mod features;
mod flip;
mod labeling;
mod lift;
mod matcher;
mod mesh_samples;
mod model_image;
mod patch;
mod piece;
mod ransac;
mod refine;
mod register;
mod residual;
mod rigid_fit;
mod sample_index;
mod scale_space;
mod slip;
mod standing;
mod states;
mod static_motion;
mod surface_error;
mod surface_graph;
mod swivel;
mod symmetry;
#[cfg(test)]
mod synthetic;

pub use descriptor::{DESCRIPTOR_LENGTH, DESCRIPTOR_NORM, Descriptor, similarity};
pub use features::{Feature, FeatureConfig, features};
pub use labeling::FreeSpace;
pub use lift::lift;
pub use matcher::{Correspondence, MatchConfig, frame_pairs, match_states, on_object};
pub use model_image::{ImageFormat, ModelImage, SIDE_MULTIPLE};
mod adam;
mod articulation_config;
mod collision;
mod consistency;
mod dense_kernel;
mod feature_grid;
mod label_fit;
mod loss_term;
mod matching_loss;
mod motion_params;
mod objective;
mod occupancy;
mod optimise;
mod ray_batch;
mod segmentation;
mod state_alignment;
mod state_model;
mod trainer_input;
mod trial;
mod uniform_batch;

pub use articulation_config::{ArticulationConfig, ColorSpace, Compatibility, LossWeights, Reading, SdfResidual};
pub use objective::ArticulationLosses;
pub use optimise::{ArticulationCheckpoint, ArticulationProblem, ArticulationStart, ArticulationTrainer};
pub use segmentation::{Dense, SegmentationField};
pub use state_alignment::{AlignedBy, AlignmentError, StateAlignment, align_states};
pub use state_model::{StateModel, SurfaceRay};
pub use trainer_input::{LabelledPoints, MAX_PARTS, TrainerError};

#[cfg(test)]
mod gradient_tests;
#[cfg(test)]
mod recovery_tests;
#[cfg(test)]
mod test_scene;
pub use mesh_samples::mesh_samples;
pub use ransac::{Proposal, RansacConfig, propose};
pub use register::{MotionSupport, RegisterConfig, RegisterError, Registration, register};
pub use standing::standing_share;
pub use states::{StatePair, United, common_refinement, unite};
pub use static_motion::static_motion;
