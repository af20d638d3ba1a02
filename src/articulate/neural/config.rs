//! Settings of the search for parts and motions (stage 2, docs/method.md 12.8).

use serde::{Deserialize, Serialize};

use crate::neural::trainer_error::TrainerError;

/// Most grid nodes along a side of the segmentation field.
const MAX_GRID_NODES: usize = 200;
/// Most samples, points or matches of one step.
const MAX_SAMPLES: usize = 4_000_000;

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
}

impl Default for LossWeights {
    fn default() -> Self {
        Self { sdf: 10.0, color: 0.1, occupancy: 5.0, collision: 50.0, matching: 500.0 }
    }
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
    /// Points per step and state for occupancy and collision, mostly from the occupied space.
    pub uniform_points: usize,
    /// Matches per step and direction.
    pub matches: usize,
    /// Labelled points per step and state while labels are fitted.
    pub label_points: usize,
    /// Grid nodes of the segmentation field along a side.
    pub grid_nodes: usize,
    /// Weight of points not seen in both states.
    pub unseen_weight: f64,
    /// Weights of the loss terms.
    pub weights: LossWeights,
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
            ("uniform_points", self.uniform_points),
            ("matches", self.matches),
            ("label_points", self.label_points),
        ];
        for (name, count) in counts {
            TrainerError::unless(
                (1..=MAX_SAMPLES).contains(&count),
                name,
                count.to_string(),
                "use 1 to 4000000",
            )?;
        }
        let w = &self.weights;
        let weights = [w.sdf, w.color, w.occupancy, w.collision, w.matching];
        TrainerError::unless(
            weights.iter().all(|w| w.is_finite() && *w >= 0.0),
            "weights",
            format!("{weights:?}"),
            "use weights of 0 or more",
        )?;
        for (name, steps) in [
            ("identity_steps", self.identity_steps),
            ("refine_steps", self.refine_steps),
            ("label_steps", self.label_steps),
        ] {
            TrainerError::unless(steps <= MAX_SAMPLES, name, steps.to_string(), "use 0 to 4000000")?;
        }
        let unseen = self.unseen_weight;
        TrainerError::unless(
            (0.0..=1.0).contains(&unseen),
            "unseen_weight",
            unseen.to_string(),
            "use 0 to 1",
        )?;
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
            uniform_points: 6000,
            matches: 512,
            label_points: 4096,
            grid_nodes: 50,
            unseen_weight: 0.5,
            weights: LossWeights::default(),
        }
    }
}
