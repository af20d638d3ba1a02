//! Settings of the search for parts and motions (stage 2, docs/method.md 12.8).

use serde::{Deserialize, Serialize};

use crate::neural::trainer_error::TrainerError;

/// Most grid nodes along a side of the segmentation field.
const MAX_GRID_NODES: usize = 200;
/// Most samples, points or matches of one step.
const MAX_SAMPLES: usize = 4_000_000;

/// Which version applies where the published text and the released program differ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MethodVersion {
    /// The published text.
    #[default]
    Paper,
    /// The released program.
    Released,
}

/// In which space colors are compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ColorSpace {
    /// Colors in `[0, 1]`.
    #[default]
    Rgb,
    /// Outputs of the networks before the sigmoid (released program).
    Logit,
}

/// How a difference of signed distances is penalised.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SdfResidual {
    /// Absolute difference (published).
    #[default]
    Absolute,
    /// Quadratic up to this many standard deviations of the ray's depth noise, absolute beyond; without
    /// influence beyond one truncation distance.
    NoiseScaled {
        /// Where the quadratic part ends, standard deviations.
        sigmas: f64,
    },
}

/// Weights of the loss terms: docs/method.md (12.19).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LossWeights {
    /// Signed distance consistency near surfaces.
    pub sdf: f64,
    /// Color consistency near surfaces.
    pub color: f64,
    /// Occupancy consistency.
    pub occupancy: f64,
    /// Collision, on ray samples and again on uniform points.
    pub collision: f64,
    /// Reprojection of pixel matches, in image heights.
    pub matching: f64,
    /// Distance of lifted matches, in truncation distances; not part of the published method.
    pub matching_3d: f64,
}

impl Default for LossWeights {
    fn default() -> Self {
        Self { sdf: 10.0, color: 0.1, occupancy: 5.0, collision: 50.0, matching: 500.0, matching_3d: 0.0 }
    }
}

/// The differences between the published text and the released program (docs/method.md 12.9), one switch
/// each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Compatibility {
    /// Near-surface weight: `paper` is `sigmoid(5q) sigmoid(-5q)` on `|q| < 1` with `q` the signed distance
    /// in truncation distances; `released` divides `q` once more by 0.03, floors it at -0.5 and cuts it at `q
    /// < 0.05`.
    pub near_surface_weight: MethodVersion,
    /// Visibility: `paper` discounts points not seen in both states; `released` discounts points seen in
    /// both.
    pub visibility: MethodVersion,
    /// Occupancy target of back-warped points: `paper` takes the state they lie in; `released` takes the
    /// state they are warped into.
    pub occupancy_target: MethodVersion,
    /// Colors before (`logit`) or after (`rgb`) the sigmoid.
    pub color_space: ColorSpace,
    /// Grid queries: `paper` is node-aligned; `released` reads at `N / (N - 1)` times the normalised
    /// position.
    pub grid_alignment: MethodVersion,
}

/// Settings of [`crate::neural::optimise::ArticulationTrainer`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ArticulationConfig {
    /// Whether parts and motions found by registration are refined by consistency between the two states'
    /// fields. Motions started from the identity are always refined.
    pub refine: bool,
    /// Optimizer steps if motions start from the identity.
    pub identity_steps: usize,
    /// Optimizer steps if motions start from a registration.
    pub refine_steps: usize,
    /// Steps of the initial fit of the segmentation to given labels.
    pub label_steps: usize,
    /// Rays per step and state.
    pub rays: usize,
    /// Samples on a ray, stratified within one truncation distance of its depth.
    pub samples_per_ray: usize,
    /// Points per step and state for occupancy and collision, mostly from the occupied space.
    pub uniform_points: usize,
    /// Matches per step and direction.
    pub matches: usize,
    /// Labelled points per step and state while labels are fitted.
    pub label_points: usize,
    /// Grid nodes of the segmentation field along a side.
    pub grid_nodes: usize,
    /// First and last learning rate of the segmentation fields; it falls exponentially.
    pub field_rate: [f64; 2],
    /// First and last learning rate of motions started from the identity (radians, and half sides of the
    /// scene cube).
    pub identity_motion_rate: [f64; 2],
    /// First and last learning rate of motions started from a registration.
    pub refine_motion_rate: [f64; 2],
    /// Share of the steps after which occupancy and collision count (docs/method.md 12.8: 500 of 2000).
    pub late_start: f64,
    /// Weight of points not seen in both states.
    pub unseen_weight: f64,
    /// Width in meters over which occupancy falls from 1 to 0; one spacing of the distance grid if not set.
    pub occupancy_ramp_m: Option<f64>,
    /// How a difference of signed distances counts.
    pub sdf_residual: SdfResidual,
    /// Whether rays are weighted inversely to their depth noise.
    pub noise_weights: bool,
    /// Whether gradients pass through visibility, which depends on the segmentation. Without them, a point
    /// gains nothing from joining a motion that takes it to a hidden place.
    pub visibility_gradient: bool,
    /// Weights of the loss terms.
    pub weights: LossWeights,
    /// Choice between the published text and the released program, one by one.
    pub compatibility: Compatibility,
}

impl ArticulationConfig {
    /// Refuses unusable settings.
    ///
    /// # Errors
    /// [`TrainerError::Setting`] with the key.
    pub fn check(&self) -> Result<(), TrainerError> {
        let nodes = self.grid_nodes;
        TrainerError::unless(
            (2..=MAX_GRID_NODES).contains(&nodes),
            "grid_nodes",
            nodes.to_string(),
            "use 2 to 200",
        )?;
        let counts = [
            ("rays", self.rays),
            ("samples_per_ray", self.samples_per_ray),
            ("uniform_points", self.uniform_points),
            ("matches", self.matches),
            ("label_points", self.label_points),
            ("rays * samples_per_ray", self.rays.saturating_mul(self.samples_per_ray)),
        ];
        for (name, count) in counts {
            TrainerError::unless(
                (1..=MAX_SAMPLES).contains(&count),
                name,
                count.to_string(),
                "use 1 to 4000000",
            )?;
        }
        for (name, range) in [
            ("field_rate", self.field_rate),
            ("identity_motion_rate", self.identity_motion_rate),
            ("refine_motion_rate", self.refine_motion_rate),
        ] {
            let ok = range.iter().all(|r| r.is_finite() && *r > 0.0);
            TrainerError::unless(ok, name, format!("{range:?}"), "use two positive rates")?;
        }
        let w = &self.weights;
        let weights = [w.sdf, w.color, w.occupancy, w.collision, w.matching, w.matching_3d];
        TrainerError::unless(
            weights.iter().all(|w| w.is_finite() && *w >= 0.0),
            "weights",
            format!("{weights:?}"),
            "use weights of 0 or more",
        )?;
        let ramp = self.occupancy_ramp_m;
        TrainerError::unless(
            ramp.is_none_or(|r| r > 0.0 && r.is_finite()),
            "occupancy_ramp_m",
            format!("{ramp:?}"),
            "use a positive length in meters",
        )?;
        for (name, steps) in [
            ("identity_steps", self.identity_steps),
            ("refine_steps", self.refine_steps),
            ("label_steps", self.label_steps),
        ] {
            TrainerError::unless(steps <= MAX_SAMPLES, name, steps.to_string(), "use 0 to 4000000")?;
        }
        if let SdfResidual::NoiseScaled { sigmas } = self.sdf_residual {
            TrainerError::unless(
                sigmas > 0.0 && sigmas.is_finite(),
                "sdf_residual",
                sigmas.to_string(),
                "use a positive number of sigmas",
            )?;
        }
        for (name, share) in [("late_start", self.late_start), ("unseen_weight", self.unseen_weight)] {
            TrainerError::unless((0.0..=1.0).contains(&share), name, share.to_string(), "use 0 to 1")?;
        }
        Ok(())
    }
}

impl Default for ArticulationConfig {
    fn default() -> Self {
        Self {
            refine: false,
            identity_steps: 2000,
            refine_steps: 400,
            label_steps: 200,
            rays: 512,
            samples_per_ray: 8,
            uniform_points: 6000,
            matches: 512,
            label_points: 4096,
            grid_nodes: 50,
            field_rate: [0.01, 0.001],
            identity_motion_rate: [0.01, 1e-5],
            refine_motion_rate: [1e-3, 1e-5],
            late_start: 0.25,
            unseen_weight: 0.5,
            occupancy_ramp_m: None,
            sdf_residual: SdfResidual::Absolute,
            noise_weights: false,
            visibility_gradient: false,
            weights: LossWeights::default(),
            compatibility: Compatibility::default(),
        }
    }
}
