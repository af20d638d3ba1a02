//! From labelled surfaces and starting motions to what is known of every part: refinement, dense texture.

use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use super::{
    JointEstimate, JointMotion, LiftedMatch, MatchEvidence, MotionEvidence, ParentMotion, RefineConfig, SquareConfig, SurfaceSamples,
    TextureConfig, estimate_joint, estimate_shared_joint, free_motion, match_evidence,
    surface_error::{ReadingHeights, clear, surface_error_m},
    symmetry::looks_alike_round,
    texture_matches,
};
use crate::{
    capture::{NoiseConfig, RgbdFrame, smoothing_m},
    geometry::{Grid3, Pose},
    model::JointKind,
};

/// Settings of the joint estimation.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct JointConfig {
    /// Robust refinement of motions.
    pub refine: RefineConfig,
    /// Dense texture matches.
    pub texture: TextureConfig,
    /// Axes along and across each other.
    pub square: SquareConfig,
}

/// What is known of one state once its surface is there.
#[derive(Clone, Copy)]
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

/// Rounds of texture matching and motion refinement: each starts from a better motion.
const ROUNDS: usize = 2;
/// Blocks along the side of a square with the area of a part, over which surface errors may run together: enough of them
/// to measure a spread, few enough for a block to be wider than what fusion smooths.
const BLOCKS_ALONG: f64 = 6.0;
/// Pieces along that side which a displacement of the fused surface shares: a side of a part may also lean.
const PIECES_ALONG: f64 = 2.0;

/// A fused surface is not told to be displaced by less than this share of its grid's spacing: interpolation moves it so far.
const UNCLEAR_SPACINGS: f64 = 0.25;

/// All that state 0 and another state show of one part.
pub struct PartEvidence {
    /// Surface points in each state.
    pub surfaces: [SurfaceSamples; 2],
    /// Lifted and dense matches on it.
    pub matches: Vec<MatchEvidence>,
    /// Its motion from state 0 to the other in the world, refined without a joint.
    pub motion: Pose,
    /// Middle of its surface in state 0.
    pub center: Point3<f64>,
    /// Distance of its farthest point from there, metres.
    pub radius_m: f64,
    /// Length over which surface errors are correlated, metres.
    correlation_m: f64,
    /// Area of its surface in each state, square metres.
    areas_m2: [f64; 2],
    /// Largest distance that counts, metres.
    reach_m: f64,
    /// Displacement of the fused surfaces, metres.
    displacement_m: f64,
    /// What it makes distances too small by at every sample of each state, metres.
    offsets_m: [Vec<f64>; 2],
}

impl PartEvidence {
    /// Evidence of part `part`, from a starting motion `state1_from_state0`. `matches` are the lifted matches on the
    /// part, `extent_m` is the longest side of the object.
    #[must_use]
    pub fn gather(
        part: u8,
        start: &Pose,
        states: &[ObservedState; 2],
        matches: &[LiftedMatch],
        noise: &NoiseConfig,
        extent_m: f64,
        config: &JointConfig,
    ) -> Self {
        let surfaces = [0, 1].map(|s| select(states[s].samples, states[s].labels, part));
        let share = |s: usize| surfaces[s].points.len() as f64 / states[s].samples.points.len().max(1) as f64;
        let areas_m2 = [0, 1].map(|s| states[s].area_m2 * share(s));
        let center = centroid(&surfaces[0]);
        let radius_m = surfaces[0].points.iter().map(|p| (p - center).norm()).fold(0.0, f64::max);
        let frames = [states[0].frames, states[1].frames];
        let spacing_m = states[0].sdf.spacing_m;
        let smoothing_m = states.iter().map(|s| smoothing_m(s.frames)).fold(0.0, f64::max);
        let matches = match_evidence(matches, frames, noise, config.refine.match_pixel_sigma, 2.0 * spacing_m);
        let sparse = matches.len();
        let correlation_m = (config.refine.correlation_spacings * spacing_m).max(smoothing_m);
        let heights = ReadingHeights::new(surfaces.each_ref(), frames, noise, correlation_m, spacing_m);
        let mut part = Self {
            surfaces,
            matches,
            motion: *start,
            center,
            radius_m,
            correlation_m,
            areas_m2,
            reach_m: config.refine.reach * extent_m,
            displacement_m: 0.0,
            offsets_m: [Vec::new(), Vec::new()],
        };
        let offsets_m = |part: &Self| heights.offsets_m(part.surfaces.each_ref(), &part.motion, correlation_m);
        for _ in 0..ROUNDS {
            part.offsets_m = offsets_m(&part).map(|o| clear(o, UNCLEAR_SPACINGS * spacing_m));
            let found = part.joint(&ParentMotion::still(), states, None, config);
            let sdf = [states[0].sdf, states[1].sdf];
            let dense = texture_matches(part.surfaces.each_ref(), frames, sdf, &found.motions[0], noise, &config.texture);
            part.matches.truncate(sparse);
            part.matches.extend(dense);
            part.motion = found.evidence.state1_from_state0;
        }
        let all = offsets_m(&part);
        part.displacement_m = surface_error_m(&all[0]);
        part.offsets_m = all.map(|o| clear(o, UNCLEAR_SPACINGS * spacing_m));
        part
    }

    /// The joint between a parent and this part; of some kind, if it is known.
    #[must_use]
    pub fn joint(
        &self,
        parent: &ParentMotion,
        states: &[ObservedState; 2],
        kind: Option<JointKind>,
        config: &JointConfig,
    ) -> JointEstimate {
        estimate_joint(&self.motion, parent, &self.evidence(states), (&self.center, self.radius_m), kind, &config.refine)
    }

    /// A turning joint, its axis moved to where it suits its direction best.
    #[must_use]
    pub fn placed(&self, joint: JointEstimate, parent: &ParentMotion, states: &[ObservedState; 2], config: &JointConfig) -> JointEstimate {
        joint.placed(parent, &self.evidence(states), &config.refine)
    }

    /// Whether the part would land as well if it had turned about the axis of a joint.
    #[must_use]
    pub fn looks_alike_round(&self, joint: &JointEstimate, states: &[ObservedState; 2], config: &JointConfig) -> bool {
        looks_alike_round(&self.evidence(states), &joint.motions[0], &joint.axis, &config.refine)
    }

    /// The motion of this part by itself, with its covariance.
    #[must_use]
    pub fn free_motion(&self, states: &[ObservedState; 2], config: &JointConfig) -> ParentMotion {
        free_motion(&self.motion, &self.evidence(states), &config.refine)
    }

    fn evidence<'a>(&'a self, states: &'a [ObservedState; 2]) -> MotionEvidence<'a> {
        let side_m = (0.5 * (self.areas_m2[0] + self.areas_m2[1])).sqrt();
        MotionEvidence {
            surfaces: [&self.surfaces[0], &self.surfaces[1]],
            sdf: [states[0].sdf, states[1].sdf],
            visible: [states[0].visible, states[1].visible],
            matches: &self.matches,
            independent_area_m2: self.correlation_m * self.correlation_m,
            areas_m2: self.areas_m2,
            reach_m: self.reach_m,
            block_m: (side_m / BLOCKS_ALONG).max(self.correlation_m),
            offsets_m: self.offsets_m.each_ref().map(Vec::as_slice),
            displacement_m: self.displacement_m,
            piece_m: (side_m / PIECES_ALONG).max(self.correlation_m),
        }
    }
}

/// Of all states those that motion `k` joins: state 0 and state `k + 1`.
#[must_use]
pub fn pair_of<'a>(states: &[ObservedState<'a>], k: usize) -> [ObservedState<'a>; 2] {
    [states[0], states[k + 1]]
}

/// The joint between a parent and a part, by the part's motions to all other states. One joint is fitted to all of them;
/// where a `doubt` is allowed, a motion that contradicts the others is left out and told. The `kind` may be known.
#[must_use]
pub fn joint_of_part(
    part: &[PartEvidence],
    parents: &[ParentMotion],
    states: &[ObservedState],
    doubt: bool,
    kind: Option<JointKind>,
    config: &JointConfig,
) -> JointEstimate {
    if let ([part], [parent]) = (part, parents) {
        return part.joint(parent, &pair_of(states, 0), kind, config);
    }
    let pairs: Vec<[ObservedState; 2]> = (0..part.len()).map(|k| pair_of(states, k)).collect();
    let mut motions: Vec<JointMotion> = part
        .iter()
        .zip(&pairs)
        .zip(parents)
        .map(|((part, pair), parent)| JointMotion { start: part.motion, parent, evidence: part.evidence(pair) })
        .collect();
    // Blocks of state 0 are counted across motions.
    let block_m = motions.iter().map(|m| m.evidence.block_m).fold(0.0, f64::max);
    motions.iter_mut().for_each(|m| m.evidence.block_m = block_m);
    let place = part.first().map_or((Point3::origin(), 0.0), |p| (p.center, p.radius_m));
    estimate_shared_joint(&motions, (&place.0, place.1), doubt, kind, &config.refine)
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
