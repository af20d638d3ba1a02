//! Pixel matches between the frames of two states by image features.

use std::path::PathBuf;

use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::features::{
    feature::{Feature, FeatureConfig, object_features},
    partner::mutual_matches,
    pixel_match::PixelMatch,
};
use crate::frame::RgbdFrame;

/// A match is kept if its descriptor distance is below this fraction of the second best distance.
/// chosen: looser than Lowe's 0.8; what follows no motion is dropped later
const RATIO: f32 = 0.85;

/// Settings of the matcher.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MatchConfig {
    /// Settings of the feature detector.
    pub features: FeatureConfig,
    /// Number of frames of the other state matched with each frame, nearest views first.
    pub neighbors: usize,
    /// ONNX file of a model for matching image pairs, in place of the built-in features.
    pub onnx: Option<PathBuf>,
    /// Longer side of images for models of variable input size, pixels.
    pub onnx_max_side_px: usize,
    /// Least confidence of a match; models without confidences give 1.
    pub onnx_min_confidence: f32,
}

impl Default for MatchConfig {
    fn default() -> Self {
        Self {
            features: FeatureConfig::default(),
            neighbors: 12,
            onnx: None,
            onnx_max_side_px: 640,
            onnx_min_confidence: 0.2,
        }
    }
}

/// A match between two frames as returned by a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correspondence {
    /// Pixel (u, v) in the frame of state 0 and in the frame of state 1.
    pub pixels: [[f32; 2]; 2],
    /// Confidence, 0 to 1.
    pub confidence: f32,
}

/// Matches of a frame pair with sufficient confidence and both ends on the object, ordered by pixel.
#[must_use]
pub fn on_object(
    states: [&[RgbdFrame]; 2],
    frame0: usize,
    frame1: usize,
    found: &[Correspondence],
    min_confidence: f32,
) -> Vec<PixelMatch> {
    let mut matches: Vec<PixelMatch> = found
        .iter()
        .filter(|c| c.confidence >= min_confidence)
        .filter(|c| is_on_object(&states[0][frame0], c.pixels[0]))
        .filter(|c| is_on_object(&states[1][frame1], c.pixels[1]))
        .map(|c| PixelMatch { frame0, pixel0: c.pixels[0], frame1, pixel1: c.pixels[1] })
        .collect();
    // Models return matches in arbitrary order.
    let key = |m: &PixelMatch| (m.pixel0.map(f32::to_bits), m.pixel1.map(f32::to_bits));
    matches.sort_by_key(key);
    matches.dedup_by_key(|m| key(m));
    matches
}

/// Whether the nearest pixel shows the object. Negative numbers and NaN become pixel 0; the pixels of models
/// have been checked before.
fn is_on_object(frame: &RgbdFrame, [u, v]: [f32; 2]) -> bool {
    let k = &frame.intrinsics;
    let u = u.round() as usize;
    let v = v.round() as usize;
    u < k.width && v < k.height && frame.is_object(v * k.width + u)
}

/// Matches between the frames of state 0 and of state 1. Every frame is matched with the nearest views of the
/// other state; matches are mutually best and pass the ratio test in both directions. Swapping the states
/// only swaps the ends of the matches and changes their order.
#[must_use]
pub fn match_states(states: [&[RgbdFrame]; 2], config: &MatchConfig) -> Vec<PixelMatch> {
    let (found0, found1) = rayon::join(
        || features_of_frames(states[0], &config.features),
        || features_of_frames(states[1], &config.features),
    );
    let matched: Vec<Vec<PixelMatch>> = frame_pairs(states, config.neighbors)
        .into_par_iter()
        .map(|(frame0, frame1)| {
            let a = &found0[frame0];
            let b = &found1[frame1];
            mutual_matches(a, b, RATIO)
                .into_iter()
                .map(|(i, j)| PixelMatch { frame0, pixel0: a[i].pixel, frame1, pixel1: b[j].pixel })
                .collect()
        })
        .collect();
    matched.into_iter().flatten().collect()
}

fn features_of_frames(frames: &[RgbdFrame], config: &FeatureConfig) -> Vec<Vec<Feature>> {
    frames.par_iter().map(|f| object_features(f, config)).collect()
}

/// Pairs of frames of the two states, in order: one is among the `neighbors` nearest views of the other.
#[must_use]
pub fn frame_pairs(states: [&[RgbdFrame]; 2], neighbors: usize) -> Vec<(usize, usize)> {
    let all: Vec<&RgbdFrame> = states.iter().flat_map(|s| s.iter()).collect();
    let count = all.len().max(1) as f64;
    let center = all.iter().map(|f| f.world_from_camera.translation.vector).sum::<Vector3<f64>>() / count;
    let distances = all.iter().map(|f| (f.world_from_camera.translation.vector - center).norm());
    let radius_m = (distances.sum::<f64>() / count).max(1e-6);
    let mut pairs = Vec::new();
    for (side, (from, to)) in [(states[0], states[1]), (states[1], states[0])].into_iter().enumerate() {
        for (i, a) in from.iter().enumerate() {
            let mut order: Vec<(f64, usize)> =
                to.iter().enumerate().map(|(j, b)| (view_distance(a, b, radius_m), j)).collect();
            order.sort_by(|p, q| p.0.total_cmp(&q.0).then(p.1.cmp(&q.1)));
            pairs.extend(order.iter().take(neighbors).map(|&(_, j)| if side == 0 { (i, j) } else { (j, i) }));
        }
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// Distance of the camera centers in mean radii, plus the length of the difference of the optical axes.
fn view_distance(a: &RgbdFrame, b: &RgbdFrame, radius_m: f64) -> f64 {
    let p = &a.world_from_camera;
    let q = &b.world_from_camera;
    let axes = (p.rotation * Vector3::z() - q.rotation * Vector3::z()).norm();
    (p.translation.vector - q.translation.vector).norm() / radius_m + axes
}
