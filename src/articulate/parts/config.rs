//! Settings of the search for parts and motions.

use serde::{Deserialize, Serialize};

use crate::propose::ransac::RansacConfig;

/// How parts and motions are found. Lengths are shares of the object's longest side.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RegisterConfig {
    /// Method of the search.
    pub method: RegisterMethod,
    /// Motions from matches.
    pub ransac: RansacConfig,
    /// Longest distance between a moved surface point and its partner in the first rounds.
    pub first_reach: f64,
    /// The same in the last rounds.
    pub last_reach: f64,
    /// Rounds of labels and motions in turn.
    pub rounds: usize,
    /// Least evidence for a motion and no other, in cells (of side `ransac.cell`): the cells of its matches
    /// beyond chance, and a sixth of the cells of surface in contradiction to the other motions. Two to three
    /// times the evidence of wrong motions between like parts of one object.
    pub least_score: f64,
    /// The static part must explain this share of the surface.
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
    /// The surface of both states explained by a motion and no other.
    #[default]
    Evidence,
    /// The difference of the surfaces and the iterated closest point, for a given number of parts.
    Difference,
}
