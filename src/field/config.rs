//! Settings and errors of training a field.

use serde::{Deserialize, Serialize};

use super::FieldConfig;
use capture::NoiseConfig;
use geometry::SceneBox;

/// Schedule, samples and loss weights of a field (docs/method.md 12).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainConfig {
    /// Shape of hash grid and networks.
    pub field: FieldConfig,
    /// Optimiser steps.
    pub steps: usize,
    /// Rays per step.
    pub rays: usize,
    /// Samples per ray in the occupied cells in front of the surface.
    pub free_samples: usize,
    /// Samples per ray within the truncation of the surface.
    pub band_samples: usize,
    /// Loss of the TSDF on background rays.
    pub background: BackgroundLoss,
    /// Learning rate of the first step.
    pub learning_rate: f64,
    /// Weight of the empty-space loss.
    pub empty_weight: f64,
    /// Weight of the surface loss, in units of squared truncation: the balance with empty space is then
    /// independent of the truncation. The published 6000, in units of the normalized cube, equal 5.4 at the
    /// published truncation of 0.03.
    pub surface_weight: f64,
    /// Share of the object rays with a color loss.
    pub color_share: f64,
    /// Truncation of the signed distance, meters; `None`: [`Self::derived_truncation_m`]. This is not a
    /// setting: the run passes that of the surfaces.
    #[serde(skip)]
    pub truncation_m: Option<f64>,
    /// Whether the network learns a residual on the fused distances instead of the distance itself.
    pub residual: bool,
    /// Whether a ray supervises only its camera's side of the fused surface.
    pub side_test: bool,
    /// Whether the surface loss fades with depth behind the surface, so that both sides of a thin wall
    /// survive.
    pub behind_falloff: bool,
    /// Whether the surface loss is weighted by expected noise and pixel weight.
    pub noise_weights: bool,
    /// Residual at which readings lose their weight late in training, standard deviations; 0 = never.
    pub outlier_sigmas: f64,
    /// Depth noise. This is not a setting: the run passes its measurement (`capture.noise`,
    /// `capture.measure_noise`).
    #[serde(skip)]
    pub noise: NoiseConfig,
}

/// Loss of the TSDF on background rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BackgroundLoss {
    /// None: such rays are not sampled.
    Off,
    /// The empty-space loss, with value 1 everywhere (the paper, read with an infinite depth).
    Empty,
    /// The TSDF must not be negative; weight 100, as in the released code. Unlike `Empty`, it does not
    /// contradict surfaces close to the ray.
    NonNegative,
}

/// Weight of the loss on rays without a hit. derived: the weight in the released code
pub(super) const NON_NEGATIVE_WEIGHT: f64 = 100.0;

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            field: FieldConfig::default(),
            steps: 500,
            rays: 2048,
            free_samples: 8,
            band_samples: 8,
            background: BackgroundLoss::NonNegative,
            learning_rate: 0.01,
            empty_weight: 1.0,
            surface_weight: 5.4,
            color_share: 1.0,
            truncation_m: None,
            residual: true,
            side_test: true,
            behind_falloff: true,
            noise_weights: true,
            outlier_sigmas: 4.0,
            noise: NoiseConfig::default(),
        }
    }
}

impl TrainConfig {
    /// The truncation, meters: as configured, or the larger of 2 % of the object's longest side and four
    /// times the median expected noise. (The published 3 cm suit objects of 1 to 2 m.)
    pub fn derived_truncation_m(&self, scene: &SceneBox, median_sigma_m: f64) -> f64 {
        self.truncation_m.unwrap_or_else(|| (0.02 * scene.extent_m()).max(4.0 * median_sigma_m))
    }

    /// Refuses values out of their ranges.
    ///
    /// # Errors
    /// [`FieldError::Config`] with the key and its range.
    pub fn validate(&self) -> Result<(), FieldError> {
        check_shape(&self.field)?;
        ensure_within("steps", self.steps as f64, 1.0, 1e7)?;
        ensure_within("rays", self.rays as f64, 1.0, 1e6)?;
        ensure_within("free_samples", self.free_samples as f64, 0.0, 1024.0)?;
        ensure_within("band_samples", self.band_samples as f64, 1.0, 1024.0)?;
        ensure_within("learning_rate", self.learning_rate, 1e-8, 1.0)?;
        ensure_within("empty_weight", self.empty_weight, 0.0, 1e6)?;
        ensure_within("surface_weight", self.surface_weight, 0.0, 1e9)?;
        ensure_within("color_share", self.color_share, 0.0, 1.0)?;
        ensure_within("outlier_sigmas", self.outlier_sigmas, 0.0, 1e3)?;
        self.truncation_m.map_or(Ok(()), |t| ensure_within("truncation_m", t, 1e-5, 1e3))
    }
}

/// Checks that a value is within its range.
pub(super) fn ensure_within(key: &'static str, value: f64, low: f64, high: f64) -> Result<(), FieldError> {
    if value >= low && value <= high { Ok(()) } else { Err(FieldError::Config { key, value, low, high }) }
}

/// Checks that the shape of a field is within its ranges.
pub(super) fn check_shape(f: &FieldConfig) -> Result<(), FieldError> {
    ensure_within("field.levels", f.levels as f64, 1.0, 32.0)?;
    ensure_within("field.base_resolution", f.base_resolution as f64, 2.0, 1024.0)?;
    ensure_within("field.finest_resolution", f.finest_resolution as f64, f.base_resolution as f64, 65536.0)?;
    ensure_within("field.log2_table_size", f64::from(f.log2_table_size), 8.0, 24.0)?;
    ensure_within("field.hidden", f.hidden as f64, 4.0, 256.0)
}

/// Why a field cannot be trained.
#[derive(Debug, thiserror::Error)]
pub enum FieldError {
    /// A configured value is out of range.
    #[error("field: {key} is {value}; it must be between {low} and {high}")]
    Config {
        /// Key in the configuration.
        key: &'static str,
        /// Configured value.
        value: f64,
        /// Smallest allowed value.
        low: f64,
        /// Largest allowed value.
        high: f64,
    },
    /// There is no usable depth reading.
    #[error(
        "field: none of the {frames} frames has a usable depth reading on the object; check the mask, the \
         depth's unit and the scene cube (edge and grazing pixels are not used)"
    )]
    NoRays {
        /// Number of given frames.
        frames: usize,
    },
    /// No frame shows a state.
    #[error("field: state {state} has no frame that looks at the scene cube; check the cameras' poses")]
    NoViews {
        /// Index of the state, 0 or 1.
        state: usize,
    },
    /// More frames than a ray can index.
    #[error("field: {frames} frames are too many, at most 65535; select fewer")]
    TooManyFrames {
        /// Number of given frames.
        frames: usize,
    },
    /// Training diverged.
    #[error(
        "the loss or a parameter is not a finite number after {step} steps; lower train.learning_rate, or \
         report this"
    )]
    NotFinite {
        /// Number of steps done.
        step: usize,
    },
    /// A checkpoint belongs to other data or another configuration.
    #[error("field: the checkpoint has {found} {what}, this run {expected}; start again without it")]
    Checkpoint {
        /// Name of the count that differs.
        what: &'static str,
        /// Count in the checkpoint.
        found: usize,
        /// Count in this run.
        expected: usize,
    },
}
