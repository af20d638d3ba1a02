//! Settings of the joint estimation.

use serde::{Deserialize, Serialize};

use crate::joints::square_axes::SquareConfig;

/// Settings of the joint estimation.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct JointConfig {
    /// How joints are estimated.
    pub inference: JointInference,
    /// Joint axes parallel or perpendicular to each other.
    pub square: SquareConfig,
}

/// How joints are estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JointInference {
    /// From all evidence of the states on the part and its possible parents.
    #[default]
    Evidence,
    /// From the motion alone, on the static part, between two states (the published method's supplement,
    /// A.4).
    Published,
}
