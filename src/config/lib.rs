//! Layered YAML configuration with the origin of every value.
//!
//! Layers, later ones win: [`Config::default`], a preset of `launch_configs/`, a file, `--set` and flags.
//! Every layer holds differences only. Values are merged as YAML and turned into a [`Config`] once; an
//! unknown key is refused with its place and the nearest valid key. Environment variables are not read.
//!
//! Each group is defined in the crate using it, the only place of its defaults. Every key is serialized (no
//! `skip_serializing_if`), since the serialized default is the list of valid keys.
//!
//! ```
//! let mut config = config::Config::preset("preview")?;
//! config.run.seed = 3;
//! # Ok::<(), config::ConfigError>(())
//! ```

mod ablation;
mod check;
mod error;
mod layers;
mod lines;
mod nearest;
mod origins;
mod preset;
mod removed;
mod run;

use serde::{Deserialize, Serialize};

pub use ablation::ABLATIONS;
pub use error::ConfigError;
pub use layers::{Layers, Resolved};
pub use origins::Origins;
pub use preset::preset_cost;
pub use run::{Engine, Init, Method, RunConfig};

use articulate::{ArticulationConfig, JointConfig, JointInference, RegisterConfig};
use capture::{CaptureConfig, MatchConfig};
use export::{ExportConfig, LookConfig};
use field::{RadianceConfig, TrainConfig};
use model::ModelConfig;
use surface::{SurfaceConfig, SurfaceSource};

/// Settings of a run: one group per layer.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// The run as a whole: seed, parts, engine.
    pub run: RunConfig,
    /// How recordings are read.
    pub capture: CaptureConfig,
    /// Object fields: shape, samples, schedule.
    pub train: TrainConfig,
    /// Radiance fields of the parts, for the method based on them.
    pub radiance: RadianceConfig,
    /// Surfaces and distance fields.
    pub surface: SurfaceConfig,
    /// Pixel matches between the states.
    pub matching: MatchConfig,
    /// Registration of matches and surfaces.
    pub register: RegisterConfig,
    /// Parts and motions from consistency between the states.
    pub articulation: ArticulationConfig,
    /// Fits of joints.
    pub joint: JointConfig,
    /// Assumptions no camera measures: density, thickness, effort.
    pub model: ModelConfig,
    /// Visual meshes and textures.
    pub look: LookConfig,
    /// What is written to the files, and how.
    pub export: ExportConfig,
}

impl Config {
    /// The settings of a built-in preset, such as `default` or `preview`.
    ///
    /// # Errors
    /// If there is no preset of this name.
    pub fn preset(name: &str) -> Result<Self, ConfigError> {
        let mut layers = Layers::new(&Self::default())?;
        // As on the command line, so both give the same settings.
        layers.add_preset(name)?;
        Ok(layers.resolve()?.config)
    }

    /// Merges all layers into a configuration.
    ///
    /// # Errors
    /// If a value cannot be used, with its origin: the file and line, or the option.
    pub fn from_layers(layers: Layers) -> Result<Resolved<Self>, ConfigError> {
        let resolved: Resolved<Self> = layers.resolve()?;
        resolved.config.check().map_err(|error| error.with_origin(&resolved.origins))?;
        Ok(resolved)
    }

    /// Whether parts and motions are found by consistency between the states' fields (docs/method.md 12.8).
    #[must_use]
    pub fn seeks_consistency(&self) -> bool {
        self.run.method == Method::Surfaces && (self.articulation.refine || self.run.init == Init::Identity)
    }

    /// Whether the run is defined for two states only.
    #[must_use]
    pub fn takes_two_states(&self) -> bool {
        self.run.method == Method::Radiance
            || self.seeks_consistency()
            || self.joint.inference == JointInference::Published
    }

    /// Whether the run needs neural fields.
    #[must_use]
    pub fn trains_fields(&self) -> bool {
        // For surfaces, or for consistency between the states.
        self.run.method == Method::Surfaces
            && (self.surface.source == SurfaceSource::Field || self.seeks_consistency())
    }
}
