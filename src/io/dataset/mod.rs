//! Dataset folders: posed images on disk, in the layouts of published articulated-object datasets.

pub(super) mod files;
mod joint_transforms;
mod keyframes;
mod matches;
mod npz;
mod pickle;
mod start_end;

pub use files::STATES;
pub use joint_transforms::{Ends, JointTransform, JointTransforms, TransformAxis};
pub use keyframes::open_keyframes;
pub use start_end::open_start_end;
