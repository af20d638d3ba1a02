//! Settings of the run as a whole.

use serde::{Deserialize, Serialize};

use super::error::ConfigError;

/// Largest number of parts in the settings.
pub(crate) const MAX_PARTS: usize = 16;

/// Settings of the run as a whole.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RunConfig {
    /// Name of the preset the settings are based on, for the report.
    pub preset: String,
    /// Seed of every random choice.
    pub seed: u64,
    /// Number of rigid parts, the static one included; null: determined from the data.
    pub parts: Option<usize>,
    /// Engine for training the fields.
    pub engine: Engine,
    /// Start of the part motions.
    pub init: Init,
    /// Method to find parts and motions.
    pub method: Method,
}

impl Default for RunConfig {
    fn default() -> Self {
        Self {
            preset: "default".to_owned(),
            seed: 0,
            parts: None,
            engine: Engine::default(),
            init: Init::default(),
            method: Method::default(),
        }
    }
}

/// Engine for training the fields.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Engine {
    /// Kernels written for this program; the fastest without a GPU.
    #[default]
    Cpu,
    /// burn on the CPU.
    Burn,
    /// burn on a GPU; needs the `gpu` feature.
    Gpu,
}

/// Method to find parts and motions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Surfaces of the states are matched, registered and compared.
    #[default]
    Surfaces,
    /// Images only: radiance fields of the parts explain them (docs/method.md 12.11).
    Radiance,
}

/// Initial part motions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Init {
    /// Robust registration of matches lifted to 3D and of geometry.
    #[default]
    Registration,
    /// The identity, as published.
    Identity,
}

impl RunConfig {
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        match self.parts {
            // A single part has no joint: an object at rest is found from the data, with `parts` null.
            Some(parts) if !(2..=MAX_PARTS).contains(&parts) => Err(ConfigError::Unusable {
                key: "run.parts".to_owned(),
                reason: format!("{parts} parts; give 2 to {MAX_PARTS}, the static part included"),
            }),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_of_parts_is_bounded() {
        let check = |parts| RunConfig { parts, ..RunConfig::default() }.check();
        for usable in [None, Some(2), Some(MAX_PARTS)] {
            check(usable).unwrap();
        }
        for unusable in [0, 1, MAX_PARTS + 1] {
            let message = check(Some(unusable)).unwrap_err().to_string();
            assert!(message.starts_with("run.parts: "), "{message}");
        }
    }
}
