//! Settings of the search for parts and motions.

use serde::{Deserialize, Serialize};

/// How parts and motions are found.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RegisterConfig {
    /// Method of the search.
    pub method: RegisterMethod,
    /// Number of rounds of alternating labels and motions.
    pub rounds: usize,
}

impl Default for RegisterConfig {
    fn default() -> Self {
        Self { method: RegisterMethod::default(), rounds: 8 }
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
