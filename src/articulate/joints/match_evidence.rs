//! Covariances of lifted matches: tight across the ray, loose along it.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix3, Point3};

use crate::{joints::motion_evidence::MatchEvidence, observations::LiftedMatch, samples::spacing::cell_of};
use capture::{NoiseConfig, RgbdFrame};

/// Covariance of a point lifted from a pixel, square meters, in world axes: `sigma_pixel * depth / f`
/// perpendicular to the ray and the depth noise along it. See docs/method.md (8.2).
fn lifted_covariance(
    point: &Point3<f64>,
    frame: &RgbdFrame,
    noise: &NoiseConfig,
    pixel_sigma: f64,
) -> Matrix3<f64> {
    let camera = frame.world_from_camera.translation.vector;
    let depth_m = frame.in_camera(point).z;
    let across = pixel_sigma * depth_m / frame.intrinsics.fx;
    let along = noise.sigma_m(depth_m);
    let ray = (point.coords - camera).normalize();
    Matrix3::identity() * (across * across) + ray * ray.transpose() * (along * along)
}

/// The evidence of matches for a motion. See docs/method.md (8.3).
///
/// Matches whose state-0 ends lie in one cell of side `cell_m` see one feature. If it was seen in `n0` frames
/// of state 0 and `n1` of state 1, its displacement is known to `sigma^2 (1/n0 + 1/n1)`, however many of the
/// pairs were matched; the shares of the `m` pairs (variance `2 sigma^2`) add up to this variance.
pub(crate) fn match_evidence(
    matches: &[LiftedMatch],
    states: [&[RgbdFrame]; 2],
    noise: &NoiseConfig,
    pixel_sigma: f64,
    cell_m: f64,
) -> Vec<MatchEvidence> {
    let mut features: BTreeMap<_, (usize, [BTreeSet<usize>; 2])> = BTreeMap::new();
    for m in matches {
        let (pairs, seen) = features.entry(cell_of(&m.point0, cell_m)).or_default();
        *pairs += 1;
        seen[0].insert(m.frames[0]);
        seen[1].insert(m.frames[1]);
    }
    matches
        .iter()
        .map(|m| {
            let (pairs, seen) = &features[&cell_of(&m.point0, cell_m)];
            let [n0, n1] = [0, 1].map(|s| seen[s].len() as f64);
            MatchEvidence {
                point0: m.point0,
                point1: m.point1,
                covariance0: lifted_covariance(&m.point0, &states[0][m.frames[0]], noise, pixel_sigma),
                covariance1: lifted_covariance(&m.point1, &states[1][m.frames[1]], noise, pixel_sigma),
                share: (2.0 * n0 * n1 / ((n0 + n1) * *pairs as f64)).min(1.0),
            }
        })
        .collect()
}
