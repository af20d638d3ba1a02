//! Motion of a camera between two of its images, by the images alone.

use rand_core::Rng;

use super::{
    landmark_motion::{LandmarkPair, landmark_motion},
    observation::Observation,
};
use geometry::Pose;

/// The pose of the first camera in the second one and the number of landmarks that follow it; `None` where
/// too few do.
#[must_use]
pub fn seen_motion(first: &Observation, second: &Observation, rng: &mut impl Rng) -> Option<(Pose, usize)> {
    let own = Pose::identity();
    let matches = first.matches_with(second);
    let pairs: Vec<LandmarkPair> = matches
        .iter()
        .map(|m| LandmarkPair::new([&own, &own], [&first.surfels, &second.surfels], *m))
        .collect();
    landmark_motion(&pairs, rng)
}
