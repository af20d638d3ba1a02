//! The result of every loss of stage 2.

use crate::neural::motion_params::MotionGradient;

/// Points per parallel work item. Fixed, so sums have the same order for every number of threads.
pub(crate) const CHUNK: usize = 256;

/// Value and gradients of a loss.
pub(crate) struct LossTerm {
    /// Value, not multiplied by the weight of the term.
    pub value: f64,
    /// Gradient by the part probabilities of the points, `parts` values a point.
    pub by_probabilities: Vec<f32>,
    /// Gradient by the motions.
    pub by_motions: MotionGradient,
}

impl LossTerm {
    /// A zero loss for a number of points.
    pub(crate) fn zero(points: usize, parts: usize) -> Self {
        Self {
            value: 0.0,
            by_probabilities: vec![0.0; points * parts],
            by_motions: MotionGradient::zero(parts),
        }
    }

    /// Joins the terms of consecutive chunks of points.
    pub(crate) fn concat(chunks: Vec<Self>, parts: usize) -> Self {
        let mut all = Self::zero(0, parts);
        // In the order of the points, whichever thread was first.
        for chunk in chunks {
            all.value += chunk.value;
            all.by_probabilities.extend(chunk.by_probabilities);
            all.by_motions.merge(&chunk.by_motions);
        }
        all
    }
}
