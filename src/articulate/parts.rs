//! From labelled surfaces and starting motions to joints: refinement, dense texture, joint type, part by part.

use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use super::{
    JointEstimate, LiftedMatch, MatchEvidence, MotionEvidence, RefineConfig, SurfaceSamples, TextureConfig, estimate_joint, match_evidence,
    texture_matches,
};
use crate::{
    capture::{NoiseConfig, RgbdFrame, smoothing_m},
    geometry::{Grid3, Pose},
};

/// Settings of the joint estimation.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct JointConfig {
    /// Robust refinement of motions.
    pub refine: RefineConfig,
    /// Dense texture matches.
    pub texture: TextureConfig,
}

/// What is known of one state once its surface is there.
pub struct ObservedState<'a> {
    /// Frames of the state.
    pub frames: &'a [RgbdFrame],
    /// Points on the whole surface.
    pub samples: &'a SurfaceSamples,
    /// Part of every point.
    pub labels: &'a [u8],
    /// Untruncated signed distance, metres.
    pub sdf: &'a Grid3<f32>,
    /// Where the state was seen.
    pub visible: &'a Grid3<bool>,
    /// Area of the whole surface, square metres.
    pub area_m2: f64,
}

/// Rounds of texture matching and joint estimation: each starts from a better motion.
const ROUNDS: usize = 2;

/// Joint of part `part`, from a starting motion `state1_from_state0`. `matches` are the lifted matches on the part.
/// `extent_m` is the longest side of the object.
#[must_use]
pub fn part_joint(
    part: u8,
    start: &Pose,
    states: &[ObservedState; 2],
    matches: &[LiftedMatch],
    noise: &NoiseConfig,
    extent_m: f64,
    config: &JointConfig,
) -> JointEstimate {
    let surfaces = [0, 1].map(|s| select(states[s].samples, states[s].labels, part));
    let share = |s: usize| surfaces[s].points.len() as f64 / states[s].samples.points.len().max(1) as f64;
    let near = centroid(&surfaces[0]);
    let frames = [states[0].frames, states[1].frames];
    let sdf = [states[0].sdf, states[1].sdf];
    let spacing_m = states[0].sdf.spacing_m;
    let smoothing_m = states.iter().map(|s| smoothing_m(s.frames)).fold(0.0, f64::max);
    let correlation_m = (config.refine.correlation_spacings * spacing_m).max(smoothing_m);
    let mut lifted = match_evidence(matches, frames, noise, config.refine.match_pixel_sigma, 2.0 * spacing_m);
    let sparse = lifted.len();
    let mut estimate = None;
    for _ in 0..ROUNDS {
        let evidence = evidence(&surfaces, states, &lifted, correlation_m, extent_m, config, [share(0), share(1)]);
        let from = estimate.as_ref().map_or(*start, |e: &JointEstimate| e.evidence.state1_from_state0);
        let found = estimate_joint(&from, &evidence, &near, &config.refine);
        let dense = texture_matches([&surfaces[0], &surfaces[1]], frames, sdf, &found.state1_from_state0, noise, &config.texture);
        lifted.truncate(sparse);
        lifted.extend(dense);
        estimate = Some(found);
    }
    let evidence = evidence(&surfaces, states, &lifted, correlation_m, extent_m, config, [share(0), share(1)]);
    let from = estimate.map_or(*start, |e| e.evidence.state1_from_state0);
    estimate_joint(&from, &evidence, &near, &config.refine)
}

fn evidence<'a>(
    surfaces: &'a [SurfaceSamples; 2],
    states: &'a [ObservedState; 2],
    matches: &'a [MatchEvidence],
    correlation_m: f64,
    extent_m: f64,
    config: &JointConfig,
    shares: [f64; 2],
) -> MotionEvidence<'a> {
    MotionEvidence {
        surfaces: [&surfaces[0], &surfaces[1]],
        sdf: [states[0].sdf, states[1].sdf],
        visible: [states[0].visible, states[1].visible],
        matches,
        independent_area_m2: correlation_m * correlation_m,
        areas_m2: [0, 1].map(|s| states[s].area_m2 * shares[s]),
        reach_m: config.refine.reach * extent_m,
    }
}

/// The points with a label.
#[must_use]
pub fn select(samples: &SurfaceSamples, labels: &[u8], part: u8) -> SurfaceSamples {
    let pick = |i: &usize| labels[*i] == part;
    let chosen: Vec<usize> = (0..labels.len()).filter(pick).collect();
    SurfaceSamples {
        points: chosen.iter().map(|&i| samples.points[i]).collect(),
        normals: chosen.iter().map(|&i| samples.normals[i]).collect(),
        colors: chosen.iter().map(|&i| samples.colors[i]).collect(),
    }
}

fn centroid(samples: &SurfaceSamples) -> Point3<f64> {
    let sum: nalgebra::Vector3<f64> = samples.points.iter().map(|p| p.coords).sum();
    Point3::from(sum / samples.points.len().max(1) as f64)
}
