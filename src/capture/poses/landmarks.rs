//! Image features matched between frames, with depth (landmarks).
//!
//! Distances along surface normals leave motions along the surfaces undetermined: a floor and the top of an
//! object do not show how far a camera slid over both. Texture does (bundle adjustment). See
//! docs/method.md 2.7.

use std::sync::Arc;

use rayon::prelude::*;

use super::{pairs::Matches, surfels::Surfels};
use crate::{
    NoiseConfig, RgbdFrame,
    features::{Feature, frame_pairs, mutual_matches, whole_image_features},
};
use common::{
    ahead::Ahead,
    stop::{Stop, Stopped},
};

/// Number of frames matched with each frame, nearest views first.
const NEIGHBORS: usize = 8;
/// Lowe's ratio. derived: the published one (Lowe 2004)
const RATIO: f32 = 0.8;

/// The features of a frame.
pub(crate) struct FrameLandmarks {
    features: Arc<Vec<Feature>>,
    /// For each feature the index of its landmark among the frame's surfels; `None` without depth.
    numbers: Vec<Option<u32>>,
}

/// The features of all frames, by state and frame.
pub(super) struct Landmarks(Vec<Vec<FrameLandmarks>>);

impl FrameLandmarks {
    /// Finds the features of a frame, with or without its mask, and adds them to its surfels as landmarks.
    pub fn find_in_frame(
        frame: &RgbdFrame,
        surfels: &mut Surfels,
        noise: &NoiseConfig,
        ahead: &Ahead,
    ) -> Self {
        let features = whole_image_features(frame, ahead);
        let numbers = surfels.set_landmarks(frame, noise, features.iter().map(|f| f.pixel.map(f64::from)));
        Self { features, numbers }
    }

    /// Number of features.
    pub fn count(&self) -> usize {
        self.features.len()
    }

    /// Index pairs of matching landmarks of two frames.
    pub fn matches_with(&self, other: &Self) -> Vec<[u32; 2]> {
        let matches = mutual_matches(&self.features, &other.features, RATIO).into_iter();
        matches.filter_map(|(m, n)| Some([self.numbers[m]?, other.numbers[n]?])).collect()
    }
}

impl Landmarks {
    /// Finds the features of all frames and adds them to the frames' surfels.
    pub fn find_in_states(
        states: &[Vec<RgbdFrame>],
        surfels: &mut [Vec<Surfels>],
        noise: &NoiseConfig,
        ahead: &Ahead,
        stop: &Stop,
    ) -> Result<Self, Stopped> {
        let of_states = states.par_iter().zip(surfels).map(|(frames, surfels)| {
            let pairs = frames.par_iter().zip(surfels.par_iter_mut());
            let found = pairs.map(|(frame, surfels)| {
                stop.check()?;
                Ok(FrameLandmarks::find_in_frame(frame, surfels, noise, ahead))
            });
            found.collect::<Result<_, Stopped>>()
        });
        Ok(Self(of_states.collect::<Result<_, Stopped>>()?))
    }

    /// Matches between the frames of a state.
    pub fn matches_within(
        &self,
        state: usize,
        frames: &[RgbdFrame],
        stop: &Stop,
    ) -> Result<Matches, Stopped> {
        let pairs = frame_pairs([frames, frames], NEIGHBORS);
        self.matches_of_pairs([state, state], pairs.into_iter().filter(|(i, j)| i < j).collect(), 0, stop)
    }

    /// Matches between the frames of two states; frames of the second are numbered after those of the first.
    pub fn matches_between(
        &self,
        states: [usize; 2],
        frames: [&[RgbdFrame]; 2],
        stop: &Stop,
    ) -> Result<Matches, Stopped> {
        self.matches_of_pairs(states, frame_pairs(frames, NEIGHBORS), frames[0].len(), stop)
    }

    fn matches_of_pairs(
        &self,
        [a, b]: [usize; 2],
        pairs: Vec<(usize, usize)>,
        behind: usize,
        stop: &Stop,
    ) -> Result<Matches, Stopped> {
        let found = pairs.par_iter().map(|&(i, j)| {
            stop.check()?;
            Ok(([i, behind + j], self.0[a][i].matches_with(&self.0[b][j])))
        });
        let found: Vec<([usize; 2], Vec<[u32; 2]>)> = found.collect::<Result<_, Stopped>>()?;
        let back = found.iter().map(|([i, j], m)| ([*j, *i], m.iter().map(|[a, b]| [*b, *a]).collect()));
        Ok(back.collect::<Vec<_>>().into_iter().chain(found).collect())
    }
}
