//! Settings of the training of a field, and its errors.

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
    /// Rays a step.
    pub rays: usize,
    /// Samples of a ray spread over the occupied cells in front of the surface.
    pub free_samples: usize,
    /// Samples of a ray within the truncation of its surface.
    pub band_samples: usize,
    /// Share of background rays, past the object, if there are any.
    pub background_share: f64,
    /// Largest distance of background rays from the object's mask, pixels.
    pub background_ring_px: usize,
    /// Loss of the TSDF on background rays.
    pub background: BackgroundLoss,
    /// Learning rate of the first step.
    pub learning_rate: f64,
    /// Factor on the learning rate at the last step.
    pub learning_rate_decay: f64,
    /// Weight of the empty-space term.
    pub empty_weight: f64,
    /// Weight of the surface term, per squared truncation: the balance against empty space is then the same
    /// at every truncation. The published 6000 a squared length of the normalized cube are 5.4 at the
    /// published truncation of 0.03.
    pub surface_weight: f64,
    /// Weight of the color term.
    pub color_weight: f64,
    /// Share of the rays on the object with a color term.
    pub color_share: f64,
    /// Sharpness of the bell of color weights along a ray: `sigmoid(a q) sigmoid(-a q)`, q in truncations.
    pub color_sharpness: f64,
    /// Truncation of the signed distance, meters; `None`: [`Self::derived_truncation_m`]. Not a setting: a
    /// run has one truncation for fields and surfaces, `surface.truncation_m`.
    #[serde(skip)]
    pub truncation_m: Option<f64>,
    /// Whether the network learns a residual on the fused distances, in place of the whole distance.
    pub residual: bool,
    /// Whether a ray teaches only its camera's side of the fused surface.
    pub side_test: bool,
    /// Initial TSDF of a fresh field, in truncations (the bias of the last geometry layer). Where
    /// nothing was observed, the field stays near it. A residual starts from 0.
    pub initial_tsdf: f64,
    /// Target distance of the surface term.
    pub distance: SurfaceDistance,
    /// Whether surface terms lose weight with depth behind the surface: both sides of a thin wall survive.
    pub behind_falloff: bool,
    /// Whether surface terms are weighted by the expected noise and the pixel's weight.
    pub noise_weights: bool,
    /// Residuals beyond this many standard deviations lose their weight in the last part of the training; 0 =
    /// never.
    pub outlier_sigmas: f64,
    /// Share of the steps after which outliers are looked for.
    pub outlier_from: f64,
    /// Depth noise. Not a setting: a run gives its measurement (`capture.noise`, `capture.measure_noise`).
    #[serde(skip)]
    pub noise: NoiseConfig,
}

/// Loss of the TSDF on background rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BackgroundLoss {
    /// Nothing: such rays are not sampled.
    Off,
    /// The empty-space term: 1 everywhere (the paper, read with an infinite depth).
    Empty,
    /// Not negative: weight 100, as the released code has it. Other than `Empty` it does not contradict
    /// surfaces close to the ray.
    NonNegative,
}

/// Target distance of the surface term.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SurfaceDistance {
    /// Along the optical axis (the released code).
    Depth,
    /// Along the ray (the paper).
    Ray,
    /// To the plane of the observed surface: nearer to the true distance on surfaces seen at an angle.
    Plane,
}

/// Weight of the term on rays without a hit. derived: the weight in the released code
pub(super) const NON_NEGATIVE_WEIGHT: f64 = 100.0;

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            field: FieldConfig::default(),
            steps: 500,
            rays: 2048,
            free_samples: 8,
            band_samples: 8,
            background_share: 0.2,
            background_ring_px: 30,
            background: BackgroundLoss::NonNegative,
            learning_rate: 0.01,
            learning_rate_decay: 0.1,
            empty_weight: 1.0,
            surface_weight: 5.4,
            color_weight: 10.0,
            color_share: 1.0,
            color_sharpness: 5.0,
            truncation_m: None,
            residual: true,
            side_test: true,
            initial_tsdf: -1.0,
            distance: SurfaceDistance::Ray,
            behind_falloff: true,
            noise_weights: true,
            outlier_sigmas: 4.0,
            outlier_from: 0.5,
            noise: NoiseConfig::default(),
        }
    }
}

impl TrainConfig {
    /// The truncation in meters: the configured one, else the larger of 2 % of the object's longest side and
    /// four times the median of the expected noise. (The published 3 cm suit objects of 1 to 2 m.)
    #[must_use]
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
        ensure_within("background_share", self.background_share, 0.0, 0.9)?;
        ensure_within("background_ring_px", self.background_ring_px as f64, 0.0, 10_000.0)?;
        ensure_within("learning_rate", self.learning_rate, 1e-8, 1.0)?;
        ensure_within("learning_rate_decay", self.learning_rate_decay, 1e-6, 1.0)?;
        ensure_within("empty_weight", self.empty_weight, 0.0, 1e6)?;
        ensure_within("surface_weight", self.surface_weight, 0.0, 1e9)?;
        ensure_within("color_weight", self.color_weight, 0.0, 1e6)?;
        ensure_within("color_share", self.color_share, 0.0, 1.0)?;
        ensure_within("color_sharpness", self.color_sharpness, 0.1, 100.0)?;
        ensure_within("initial_tsdf", self.initial_tsdf, -10.0, 10.0)?;
        ensure_within("outlier_sigmas", self.outlier_sigmas, 0.0, 1e3)?;
        ensure_within("outlier_from", self.outlier_from, 0.0, 1.0)?;
        self.truncation_m.map_or(Ok(()), |t| ensure_within("truncation_m", t, 1e-5, 1e3))
    }
}

/// Refuses a configured value out of its range.
pub(super) fn ensure_within(key: &'static str, value: f64, low: f64, high: f64) -> Result<(), FieldError> {
    if value >= low && value <= high { Ok(()) } else { Err(FieldError::Config { key, value, low, high }) }
}

/// Refuses shapes of a field out of their ranges.
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
        /// Its value.
        value: f64,
        /// Smallest allowed.
        low: f64,
        /// Largest allowed.
        high: f64,
    },
    /// No depth reading can be used.
    #[error(
        "field: none of the {frames} frames has a usable depth reading on the object; check the mask, the \
         depth's unit and the scene cube (edge and grazing pixels are not used)"
    )]
    NoRays {
        /// Frames given.
        frames: usize,
    },
    /// A state was never seen.
    #[error("field: state {state} has no frame that looks at the scene cube; check the cameras' poses")]
    NoViews {
        /// 0 or 1.
        state: usize,
    },
    /// More frames than a ray can name.
    #[error("field: {frames} frames are too many, at most 65535; select fewer")]
    TooManyFrames {
        /// Frames given.
        frames: usize,
    },
    /// The optimisation ran away.
    #[error(
        "the loss or a parameter is not a finite number after {step} steps; lower train.learning_rate, or \
         report this"
    )]
    NotFinite {
        /// Steps done.
        step: usize,
    },
    /// A checkpoint belongs to other data or another configuration.
    #[error("field: the checkpoint has {found} {what}, this run {expected}; start again without it")]
    Checkpoint {
        /// Name of the compared count.
        what: &'static str,
        /// In the checkpoint.
        found: usize,
        /// In this run.
        expected: usize,
    },
}
