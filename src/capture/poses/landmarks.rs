//! Image features that frames share.
//!
//! Surfaces that are compared along their normals leave open what lies along them: a floor and the top of an
//! object do not show how far a camera slid over both. Texture does (bundle adjustment).
//! See docs/method.md 2.7.

use std::sync::Arc;

use rayon::prelude::*;

use super::{pairs::Matches, surfels::Surfels};
use crate::{
    NoiseConfig, RgbdFrame,
    features::{Feature, KnownFeatures, frame_pairs, mutual_matches},
};
use common::stop::{Stop, Stopped};

/// Frames that every frame is matched with: those seen from nearest by.
const NEIGHBORS: usize = 8;
/// Lowe's ratio. derived: the published one (Lowe 2004)
const RATIO: f32 = 0.8;

/// The features of a frame.
pub(crate) struct FrameLandmarks {
    features: Arc<Vec<Feature>>,
    /// Number of each among the landmarks of the frame's surfels, where its depth is known.
    numbers: Vec<Option<u32>>,
}

/// The features of all frames of all states, by state and frame.
pub(super) struct Landmarks(Vec<Vec<FrameLandmarks>>);

impl FrameLandmarks {
    /// Finds features, under a mask or not, and gives them to the surfels of their frame.
    pub fn find(
        frame: &RgbdFrame,
        surfels: &mut Surfels,
        noise: &NoiseConfig,
        known: &KnownFeatures,
    ) -> Self {
        let features = known.of(frame);
        let numbers = surfels.set_landmarks(frame, noise, features.iter().map(|f| f.pixel.map(f64::from)));
        Self { features, numbers }
    }

    /// Features.
    pub fn count(&self) -> usize {
        self.features.len()
    }

    /// Landmarks of this frame and of another that look alike, by their numbers.
    pub fn matches(&self, other: &Self) -> Vec<[u32; 2]> {
        let numbers = |(m, n): (usize, usize)| Some([self.numbers[m]?, other.numbers[n]?]);
        mutual_matches(&self.features, &other.features, RATIO).into_iter().filter_map(numbers).collect()
    }
}

impl Landmarks {
    /// Those of all frames; see [`FrameLandmarks::find`].
    pub fn find(
        states: &[Vec<RgbdFrame>],
        surfels: &mut [Vec<Surfels>],
        noise: &NoiseConfig,
        known: &KnownFeatures,
        stop: &Stop,
    ) -> Result<Self, Stopped> {
        let of_state = |(frames, surfels): (&Vec<RgbdFrame>, &mut Vec<Surfels>)| {
            let pairs = frames.par_iter().zip(surfels.par_iter_mut());
            let find = |(frame, surfels): (&RgbdFrame, &mut Surfels)| {
                stop.check()?;
                Ok(FrameLandmarks::find(frame, surfels, noise, known))
            };
            pairs.map(find).collect::<Result<_, Stopped>>()
        };
        Ok(Self(states.par_iter().zip(surfels).map(of_state).collect::<Result<_, Stopped>>()?))
    }

    /// Matches between the frames of a state.
    pub fn within(&self, state: usize, frames: &[RgbdFrame], stop: &Stop) -> Result<Matches, Stopped> {
        let pairs = frame_pairs([frames, frames], NEIGHBORS);
        self.of([state, state], pairs.into_iter().filter(|(i, j)| i < j).collect(), 0, stop)
    }

    /// Matches between the frames of two states; those of the second are counted behind those of the first.
    pub fn between(
        &self,
        states: [usize; 2],
        frames: [&[RgbdFrame]; 2],
        stop: &Stop,
    ) -> Result<Matches, Stopped> {
        self.of(states, frame_pairs(frames, NEIGHBORS), frames[0].len(), stop)
    }

    fn of(
        &self,
        [a, b]: [usize; 2],
        pairs: Vec<(usize, usize)>,
        behind: usize,
        stop: &Stop,
    ) -> Result<Matches, Stopped> {
        let matched = |&(i, j): &(usize, usize)| {
            stop.check()?;
            Ok(([i, behind + j], self.0[a][i].matches(&self.0[b][j])))
        };
        let found: Vec<([usize; 2], Vec<[u32; 2]>)> =
            pairs.par_iter().map(matched).collect::<Result<_, Stopped>>()?;
        let back = found.iter().map(|([i, j], m)| ([*j, *i], m.iter().map(|[a, b]| [*b, *a]).collect()));
        Ok(back.collect::<Vec<_>>().into_iter().chain(found).collect())
    }
}
