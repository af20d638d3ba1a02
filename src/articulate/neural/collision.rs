//! Collision between parts (docs/method.md 12.8): no place may be filled more than once.

use crate::neural::{loss_term::LossTerm, occupancy::BackwardFlow};

/// Mean of `max(0, O(x) - 1)^2`.
pub(crate) fn collision_loss(flow: &BackwardFlow<'_>, probabilities: &[f32]) -> LossTerm {
    flow.occupancy_mean_loss(probabilities, |_, occupancy| {
        let excess = (occupancy - 1.0).max(0.0);
        (excess * excess, 2.0 * excess)
    })
}
