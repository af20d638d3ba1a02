//! Weight of a reading in each frame pair it enters.
//!
//! A reading that n - 1 other frames share is compared with each of them in both directions, but is still one
//! reading. With weights 1/n the mean over all frames has the information of n readings (pairwise likelihood:
//! Lindsay 1988). See docs/method.md 2.7.

use std::collections::BTreeSet;

/// Weights of a frame's readings.
pub(super) struct ReadingWeights {
    pub of_surfels: f64,
    pub of_landmarks: f64,
}

impl ReadingWeights {
    /// For a frame with surfels shared by `others` frames on average, and landmarks matched as listed.
    pub fn of_frame(others: f64, matched: impl Iterator<Item = u32>) -> Self {
        let mut landmarks = BTreeSet::new();
        let mut matches = 0usize;
        matched.for_each(|landmark| {
            landmarks.insert(landmark);
            matches += 1;
        });
        let per_landmark = matches as f64 / landmarks.len().max(1) as f64;
        Self { of_surfels: 1.0 / (1.0 + others), of_landmarks: 1.0 / (1.0 + per_landmark) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_two_frames_share_counts_by_half() {
        let weights = ReadingWeights::of_frame(1.0, [3, 4, 7].into_iter());
        assert_eq!([weights.of_surfels, weights.of_landmarks], [0.5; 2]);
        // One landmark matched in three other frames, one in one: two on average.
        let weights = ReadingWeights::of_frame(0.0, [3, 3, 3, 5].into_iter());
        assert_eq!([weights.of_surfels, weights.of_landmarks], [1.0, 1.0 / 3.0]);
    }
}
