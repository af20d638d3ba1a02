//! Settings of the search for parts and motions.

use serde::{Deserialize, Serialize};

use crate::propose::ransac::RansacConfig;

/// How parts and motions are found. Lengths are shares of the object's longest side.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RegisterConfig {
    /// Method of the search.
    pub method: RegisterMethod,
    /// Settings for motions proposed by matches.
    pub ransac: RansacConfig,
    /// Largest distance between a moved surface point and its partner in the first rounds.
    pub first_reach: f64,
    /// The same distance in the last rounds.
    pub last_reach: f64,
    /// Number of rounds of alternating labels and motions.
    pub rounds: usize,
    /// Least evidence that only a motion itself explains, in cells (of side `ransac.cell`): the cells of its
    /// matches beyond chance, and a sixth of the cells of surface that contradict the other motions. It is
    /// two to three times the evidence of wrong motions between similar parts of one object.
    pub least_score: f64,
    /// Least share of the surface that the static part must explain.
    pub least_static_share: f64,
}

impl Default for RegisterConfig {
    fn default() -> Self {
        Self {
            method: RegisterMethod::default(),
            ransac: RansacConfig::default(),
            first_reach: 0.03,
            last_reach: 0.015,
            rounds: 8,
            least_score: 14.0,
            least_static_share: 0.02,
        }
    }
}

/// Method of the search for parts and motions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RegisterMethod {
    /// Each motion must explain surface of both states that no other motion explains.
    #[default]
    Evidence,
    /// The difference of the surfaces, and the iterated closest point, for a given number of parts.
    Difference,
}
