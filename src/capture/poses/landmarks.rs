//! Image features that frames share.
//!
//! Surfaces that are compared along their normals leave open what lies along them: a floor and the top of an
//! object do not show how far a camera slid over both. Texture does (bundle adjustment).
//! See docs/method.md 2.7.

use rayon::prelude::*;

use super::{pairs::Matches, surfels::Surfels};
use crate::capture::{
    NoiseConfig, RgbdFrame,
    features::{Feature, FeatureConfig, features, frame_pairs, mutual_matches},
};

/// Frames that every frame is matched with: those seen from nearest by.
const NEIGHBORS: usize = 8;
/// Lowe's ratio.
const RATIO: f32 = 0.8;
/// Most features of a frame.
const MOST: usize = 600;

/// The features of all frames of all states.
pub(super) struct Landmarks {
    /// By state and frame.
    features: Vec<Vec<Vec<Feature>>>,
    /// Number of each among the landmarks of its frame's surfels, where its depth is known.
    numbers: Vec<Vec<Vec<Option<u32>>>>,
}

impl Landmarks {
    /// Finds features and gives them to the surfels of their frames.
    pub fn find(states: &[Vec<RgbdFrame>], surfels: &mut [Vec<Surfels>], noise: &NoiseConfig) -> Self {
        // At the size of the image: features of less than two pixels are noise in a view by hand.
        let config = FeatureConfig { upsample: false, limit: MOST, ..FeatureConfig::default() };
        let of_frame = |f: &RgbdFrame| features(&RgbdFrame { mask: None, ..f.clone() }, &config);
        let features: Vec<Vec<Vec<Feature>>> =
            states.iter().map(|frames| frames.par_iter().map(of_frame).collect()).collect();
        let give = |((frame, surfels), features): ((&RgbdFrame, &mut Surfels), &Vec<Feature>)| {
            surfels.set_landmarks(frame, noise, features.iter().map(|f| f.pixel.map(f64::from)))
        };
        let numbers = states
            .iter()
            .zip(surfels)
            .zip(&features)
            .map(|((frames, surfels), features)| {
                frames.par_iter().zip(surfels.par_iter_mut()).zip(features).map(give).collect()
            })
            .collect();
        Self { features, numbers }
    }

    /// Matches between the frames of a state.
    pub fn within(&self, state: usize, frames: &[RgbdFrame]) -> Matches {
        let pairs = frame_pairs([frames, frames], NEIGHBORS);
        self.of([state, state], pairs.into_iter().filter(|(i, j)| i < j).collect(), 0)
    }

    /// Matches between the frames of two states; those of the second are counted behind those of the first.
    pub fn between(&self, states: [usize; 2], frames: [&[RgbdFrame]; 2]) -> Matches {
        self.of(states, frame_pairs(frames, NEIGHBORS), frames[0].len())
    }

    fn of(&self, [a, b]: [usize; 2], pairs: Vec<(usize, usize)>, behind: usize) -> Matches {
        let matched = |&(i, j): &(usize, usize)| {
            let numbers = |(m, n): (usize, usize)| Some([self.numbers[a][i][m]?, self.numbers[b][j][n]?]);
            let found: Vec<[u32; 2]> = mutual_matches(&self.features[a][i], &self.features[b][j], RATIO)
                .into_iter()
                .filter_map(numbers)
                .collect();
            ([i, behind + j], found)
        };
        let found: Vec<([usize; 2], Vec<[u32; 2]>)> = pairs.par_iter().map(matched).collect();
        let back = found.iter().map(|([i, j], m)| ([*j, *i], m.iter().map(|[a, b]| [*b, *a]).collect()));
        back.collect::<Vec<_>>().into_iter().chain(found).collect()
    }
}
