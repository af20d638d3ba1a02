//! Settings of the joint estimation.

use serde::{Deserialize, Serialize};

use crate::articulate::joints::{
    motion_evidence::RefineConfig, square_axes::SquareConfig, texture::TextureConfig,
};

/// Settings of the joint estimation.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct JointConfig {
    /// Robust refinement of motions.
    pub refine: RefineConfig,
    /// Dense texture matches.
    pub texture: TextureConfig,
    /// Axes along and across each other.
    pub square: SquareConfig,
}
