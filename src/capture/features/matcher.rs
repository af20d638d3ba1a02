//! Pixel matches between the frames of two states by their features.

use std::path::PathBuf;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::capture::features::{
    descriptor::{DESCRIPTOR_NORM, dot},
    feature::{Feature, FeatureConfig, features},
    pixel_match::PixelMatch,
};
use crate::{capture::frame::RgbdFrame, vectors::vectorized};

/// How matches are found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MatchConfig {
    /// Features of a frame.
    pub features: FeatureConfig,
    /// Frames of the other state that every frame is matched with: those seen from nearest by.
    pub neighbors: usize,
    /// A match is kept where its descriptor distance is below this share of the distance to the second best.
    pub ratio: f32,
    /// ONNX file of a model that matches pairs of images, in place of the built-in features.
    pub onnx: Option<PathBuf>,
    /// Longer side of the images for a model that takes any size, pixels.
    pub onnx_max_side_px: usize,
    /// Matches below this confidence are dropped; a model without confidences gives 1.
    pub onnx_min_confidence: f32,
}

impl Default for MatchConfig {
    fn default() -> Self {
        Self {
            features: FeatureConfig::default(),
            neighbors: 12,
            ratio: 0.85,
            onnx: None,
            onnx_max_side_px: 640,
            onnx_min_confidence: 0.2,
        }
    }
}

/// A match as a model finds it in two frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correspondence {
    /// Pixels (u, v) of the frame of state 0 and of that of state 1.
    pub pixels: [[f32; 2]; 2],
    /// How sure the model is, 0 to 1.
    pub confidence: f32,
}

/// Matches of a pair of frames whose confidence suffices and whose ends both lie on the object, in order of
/// their pixels.
#[must_use]
pub fn on_object(
    states: [&[RgbdFrame]; 2],
    (frame0, frame1): (usize, usize),
    found: &[Correspondence],
    min_confidence: f32,
) -> Vec<PixelMatch> {
    let object = |frame: &RgbdFrame, [u, v]: [f32; 2]| {
        let k = &frame.intrinsics;
        // A negative number or NaN becomes pixel 0 here; models' pixels were checked against their frames
        // before.
        let (u, v) = (u.round() as usize, v.round() as usize);
        u < k.width && v < k.height && frame.is_object(v * k.width + u)
    };
    let kept = |c: &&Correspondence| {
        c.confidence >= min_confidence
            && object(&states[0][frame0], c.pixels[0])
            && object(&states[1][frame1], c.pixels[1])
    };
    let mut matches: Vec<PixelMatch> = found
        .iter()
        .filter(kept)
        .map(|c| PixelMatch { frame0, pixel0: c.pixels[0], frame1, pixel1: c.pixels[1] })
        .collect();
    // Models give their matches in an order of their own.
    let key = |m: &PixelMatch| (m.pixel0.map(f32::to_bits), m.pixel1.map(f32::to_bits));
    matches.sort_by_key(key);
    matches.dedup_by_key(|m| key(m));
    matches
}

/// Features closer than this to the best match are the same place, pixels; tuned: shared/bags.
const SAME_PLACE_PX: f32 = 2.0;

/// Matches between the frames of state 0 and those of state 1: every frame with the frames of the other state
/// that look from nearest by, best in both directions and clearly better than the second best in both.
/// Swapping the states swaps the ends of the matches and changes nothing else but their order.
#[must_use]
pub fn match_states(states: [&[RgbdFrame]; 2], config: &MatchConfig) -> Vec<PixelMatch> {
    let found: [Vec<Vec<Feature>>; 2] =
        states.map(|frames| frames.par_iter().map(|f| features(f, &config.features)).collect());
    let pairs = frame_pairs(states, config.neighbors);
    let matched: Vec<Vec<PixelMatch>> = pairs
        .par_iter()
        .map(|&(frame0, frame1)| {
            let (a, b) = (&found[0][frame0], &found[1][frame1]);
            let matches = mutual_matches(a, b, config.ratio);
            matches
                .into_iter()
                .map(|(i, j)| PixelMatch { frame0, pixel0: a[i].pixel, frame1, pixel1: b[j].pixel })
                .collect()
        })
        .collect();
    matched.into_iter().flatten().collect()
}

/// Pairs of frames of the two states of which one is among the `neighbors` nearest of the other, in order.
#[must_use]
pub fn frame_pairs(states: [&[RgbdFrame]; 2], neighbors: usize) -> Vec<(usize, usize)> {
    let all = || states.iter().flat_map(|s| s.iter());
    let count = all().count().max(1) as f64;
    let center =
        all().map(|f| f.world_from_camera.translation.vector).sum::<nalgebra::Vector3<f64>>() / count;
    let radius = (all().map(|f| (f.world_from_camera.translation.vector - center).norm()).sum::<f64>()
        / count)
        .max(1e-6);
    // Distance of the centers in mean radii plus the length between the unit optical axes.
    let distance = |a: &RgbdFrame, b: &RgbdFrame| {
        let (p, q) = (&a.world_from_camera, &b.world_from_camera);
        let axes = (p.rotation * nalgebra::Vector3::z() - q.rotation * nalgebra::Vector3::z()).norm();
        (p.translation.vector - q.translation.vector).norm() / radius + axes
    };
    let mut pairs = Vec::new();
    for (side, (from, to)) in [(states[0], states[1]), (states[1], states[0])].into_iter().enumerate() {
        for (i, a) in from.iter().enumerate() {
            let mut order: Vec<(f64, usize)> =
                to.iter().enumerate().map(|(j, b)| (distance(a, b), j)).collect();
            order.sort_by(|p, q| p.0.total_cmp(&q.0).then(p.1.cmp(&q.1)));
            pairs.extend(order.iter().take(neighbors).map(|&(_, j)| if side == 0 { (i, j) } else { (j, i) }));
        }
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// Index and inner product of the best partner, and the inner product of the best one at another place.
fn best_two(row: &[i32], partners: &[Feature]) -> Option<(usize, i32, i32)> {
    let (best, &top) = row.iter().enumerate().rev().max_by_key(|(_, s)| **s)?;
    let [u, v] = partners[best].pixel;
    let far = |f: &Feature| (f.pixel[0] - u).abs() > SAME_PLACE_PX || (f.pixel[1] - v).abs() > SAME_PLACE_PX;
    // A feature found at two scales or orientations must not fail the test against itself.
    let second = row.iter().zip(partners).filter(|(_, f)| far(f)).map(|(s, _)| *s).max().unwrap_or(0);
    Some((best, top, second))
}

vectorized! {
    /// Inner products of the descriptors of each of `a` with each of `b`. Those of integers are exact,
    /// whatever the instruction set.
    fn inner_products(a: &[Feature], b: &[Feature], products: &mut [i32]) = products_of
}

#[inline(always)]
fn products_of(a: &[Feature], b: &[Feature], products: &mut [i32]) {
    for (f, row) in a.iter().zip(products.chunks_exact_mut(b.len())) {
        for (g, product) in b.iter().zip(row) {
            *product = dot(&f.descriptor, &g.descriptor);
        }
    }
}

/// Indices of features that are each other's best match and pass the ratio test in both directions.
pub(in crate::capture) fn mutual_matches(a: &[Feature], b: &[Feature], ratio: f32) -> Vec<(usize, usize)> {
    if a.is_empty() || b.is_empty() {
        return Vec::new();
    }
    let mut products = vec![0; a.len() * b.len()];
    inner_products(a, b, &mut products);
    // Squared distance of unit vectors: 2 - 2 cosine.
    let squared = |product: i32| (2.0 - 2.0 * product as f32 / (DESCRIPTOR_NORM * DESCRIPTOR_NORM)).max(0.0);
    let clear = |(best, top, second): (usize, i32, i32)| {
        (squared(top) < ratio * ratio * squared(second)).then_some(best)
    };
    let forward: Vec<Option<usize>> = (0..a.len())
        .map(|i| best_two(&products[i * b.len()..(i + 1) * b.len()], b).and_then(clear))
        .collect();
    let mut column = vec![0; a.len()];
    let mut matches = Vec::new();
    for (i, j) in forward.iter().enumerate().filter_map(|(i, j)| Some((i, (*j)?))) {
        column.iter_mut().enumerate().for_each(|(r, c)| *c = products[r * b.len() + j]);
        if let Some(back) = best_two(&column, a).and_then(clear)
            // A feature with several orientations stands in the list once for each of them.
            && (back == i || a[back].pixel == a[i].pixel)
        {
            matches.push((i, j));
        }
    }
    // A feature with several orientations may match several times.
    let key = |&(i, j): &(usize, usize)| (a[i].pixel.map(f32::to_bits), b[j].pixel.map(f32::to_bits));
    matches.sort_by_key(key);
    matches.dedup_by_key(|m| key(m));
    matches
}
