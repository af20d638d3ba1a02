//! Evidence on one part from state 0 and another state: surfaces, matches, texture, and the motion they give.

use nalgebra::{Point3, Vector3};

use crate::{
    joints::{
        drawn_residuals::DrawnResiduals,
        estimate::{JointChoice, estimate_joint},
        free_motion::{ParentMotion, free_motion},
        joint_fit::{JointMotion, PartPlace},
        match_evidence::match_evidence,
        motion_evidence::{MatchEvidence, MotionEvidence},
        surface_draws::SurfaceDraws,
        surface_error::{ReadingHeights, clear_offsets, surface_error_m},
        texture::texture_matches,
    },
    observations::{LiftedMatch, SurfaceSamples},
};
use capture::{NoiseConfig, RgbdFrame, smoothing_m};
use geometry::{Grid3, Pose};

/// Observations of one state, with its surface.
#[derive(Clone, Copy)]
pub struct ObservedState<'a> {
    /// Frames of the state.
    pub frames: &'a [RgbdFrame],
    /// Points on the whole surface.
    pub samples: &'a SurfaceSamples,
    /// Part label of every point.
    pub labels: &'a [u8],
    /// Untruncated signed distance, meters.
    pub sdf: &'a Grid3<f32>,
    /// Where the state was seen.
    pub visible: &'a Grid3<bool>,
    /// Area of the whole surface, square meters.
    pub area_m2: f64,
    /// Displacements of the points by drawn errors of poses and depth.
    pub draws: &'a SurfaceDraws,
}

impl ObservedState<'_> {
    /// Points on the surface of one part.
    pub fn samples_of_part(&self, part: u8) -> SurfaceSamples {
        self.samples.chosen_samples(&self.points_of(part))
    }

    fn points_of(&self, part: u8) -> Vec<usize> {
        (0..self.labels.len()).filter(|&i| self.labels[i] == part).collect()
    }
}

/// Largest distance between corresponding points of a part, as a share of the object's longest side.
///
/// chosen: far beyond the errors of motions by then, below the size of a part
pub const JOINT_REACH: f64 = 0.03;
/// Length over which errors of a reconstructed surface are correlated, in grid spacings.
///
/// chosen: fusion smooths over neighboring nodes
const CORRELATION_SPACINGS: f64 = 3.0;
/// Standard deviation of a match's position in the image, pixels.
///
/// chosen: features are found to a fraction of a pixel in a doubled image, and seen from two sides
const MATCH_SIGMA_PX: f64 = 1.0;
/// Rounds of texture matching and motion refinement; each starts from a better motion.
const ROUNDS: usize = 2;
/// Number of blocks of correlated surface errors along the side of a square with the area of a part: enough
/// of them to measure a spread, few enough that a block is wider than the smoothing of fusion.
///
/// tuned: shared/bags
const BLOCKS_ALONG: f64 = 6.0;
/// Number of patches displaced as one along the same side: a side of a part may also tilt.
///
/// derived: two, the fewest for a tilt
const PATCHES_ALONG: f64 = 2.0;
/// Displacements of a fused surface below this share of its grid's spacing are unknown: interpolation moves
/// it as far.
///
/// tuned: shared/bags
const UNCLEAR_SPACINGS: f64 = 0.25;

/// All evidence on one part from state 0 and another state.
pub struct PairEvidence<'a> {
    states: [ObservedState<'a>; 2],
    /// Surface points of the part in each state.
    pub surfaces: [SurfaceSamples; 2],
    /// Lifted and dense matches on it.
    pub matches: Vec<MatchEvidence>,
    /// Its motion from state 0 to the other in the world, refined without a joint.
    pub motion: Pose,
    /// Position and size of the part in state 0.
    pub place: PartPlace,
    /// Length over which surface errors are correlated, meters.
    correlation_m: f64,
    /// Area of its surface in each state, square meters.
    areas_m2: [f64; 2],
    /// Largest distance that counts, meters.
    reach_m: f64,
    /// Remaining displacement of the fused surfaces, meters.
    displacement_m: f64,
    /// By how much displaced surfaces make the distance of every sample of each state too small, meters.
    offsets_m: [Vec<f64>; 2],
    /// Changes of the residuals by drawn errors of poses and depth.
    drawn: DrawnResiduals,
}

impl<'a> PairEvidence<'a> {
    /// Gathers the evidence on part `part`, from a starting motion `state1_from_state0`. `matches` are the
    /// lifted matches on the part; `extent_m` is the longest side of the object.
    pub fn gather(
        part: u8,
        start: &Pose,
        states: [ObservedState<'a>; 2],
        matches: &[LiftedMatch],
        noise: &NoiseConfig,
        extent_m: f64,
    ) -> Self {
        let surfaces = states.each_ref().map(|s| s.samples_of_part(part));
        let areas_m2 = [0, 1].map(|s| {
            // Samples are uniform over the area, so their share is the share of the area.
            let share = surfaces[s].points.len() as f64 / states[s].samples.points.len().max(1) as f64;
            states[s].area_m2 * share
        });
        let frames = states.map(|s| s.frames);
        let spacing_m = states[0].sdf.spacing_m;
        let smoothing_m = states.iter().map(|s| smoothing_m(s.frames)).fold(0.0, f64::max);
        let matches = match_evidence(matches, frames, noise, MATCH_SIGMA_PX, 2.0 * spacing_m);
        let mut pair = Self {
            states,
            place: place_of_surface(&surfaces[0]),
            surfaces,
            matches,
            motion: *start,
            correlation_m: (CORRELATION_SPACINGS * spacing_m).max(smoothing_m),
            areas_m2,
            reach_m: JOINT_REACH * extent_m,
            displacement_m: 0.0,
            offsets_m: [Vec::new(), Vec::new()],
            drawn: DrawnResiduals::default(),
        };
        let draws = states.map(|s| s.draws.chosen_samples(&s.points_of(part)));
        pair.drawn = pair.drawn_residuals(&draws);
        pair.refine_motion(noise, &draws);
        pair
    }

    /// Changes of the residuals at the present motion.
    fn drawn_residuals(&self, draws: &[SurfaceDraws; 2]) -> DrawnResiduals {
        let matches: Vec<[Point3<f64>; 2]> = self.matches.iter().map(|m| [m.point0, m.point1]).collect();
        DrawnResiduals::new(draws, self.surfaces.each_ref(), &matches, &self.motion, self.correlation_m)
    }

    /// Repeats: surface offsets, joint, dense texture.
    fn refine_motion(&mut self, noise: &NoiseConfig, draws: &[SurfaceDraws; 2]) {
        let (frames, sdf) = (self.states.map(|s| s.frames), self.states.map(|s| s.sdf));
        let spacing_m = sdf[0].spacing_m;
        let correlation_m = self.correlation_m;
        let heights = ReadingHeights::new(self.surfaces.each_ref(), frames, noise, correlation_m, spacing_m);
        let unclear_m = UNCLEAR_SPACINGS * spacing_m;
        // In the next round, with its better motion, new dense matches replace these.
        let sparse = self.matches.len();
        for _ in 0..ROUNDS {
            let offsets_m = heights.offsets_m(self.surfaces.each_ref(), &self.motion, correlation_m);
            self.offsets_m = offsets_m.map(|o| clear_offsets(o, unclear_m));
            let still = ParentMotion::static_part();
            let found = estimate_joint(&[self.joint_motion(&still)], self.place, JointChoice::default());
            let surfaces = self.surfaces.each_ref();
            let motion = &found.motions[0];
            let dense = texture_matches(surfaces, frames, sdf, motion, noise);
            self.matches.truncate(sparse);
            self.matches.extend(dense);
            // Texture was looked for under the joint's motion (less affected by noise); fits start from the
            // free one (not bent by a wrong joint).
            self.motion = found.evidence.state1_from_state0;
            self.drawn = self.drawn_residuals(draws);
        }
        // The offsets under the final motion are the remaining error.
        let offsets_m = heights.offsets_m(self.surfaces.each_ref(), &self.motion, correlation_m);
        self.displacement_m = surface_error_m(&offsets_m[0]);
        self.offsets_m = offsets_m.map(|o| clear_offsets(o, unclear_m));
    }

    /// The evidence for the part's motion, given the parent's motion.
    pub fn joint_motion<'m>(&'m self, parent: &'m ParentMotion) -> JointMotion<'m> {
        JointMotion { start: self.motion, parent, evidence: self.motion_evidence() }
    }

    /// The motion of this part without a joint, with its covariance.
    pub fn free_motion(&self) -> ParentMotion {
        free_motion(&self.motion, &self.motion_evidence())
    }

    /// The evidence that gives the residuals of a motion.
    pub fn motion_evidence(&self) -> MotionEvidence<'_> {
        let side_m = (0.5 * (self.areas_m2[0] + self.areas_m2[1])).sqrt();
        MotionEvidence {
            surfaces: self.surfaces.each_ref(),
            sdf: self.states.map(|s| s.sdf),
            visible: self.states.map(|s| s.visible),
            matches: &self.matches,
            independent_area_m2: self.correlation_m * self.correlation_m,
            areas_m2: self.areas_m2,
            reach_m: self.reach_m,
            block_m: (side_m / BLOCKS_ALONG).max(self.correlation_m),
            offsets_m: self.offsets_m.each_ref().map(Vec::as_slice),
            displacement_m: self.displacement_m,
            patch_m: (side_m / PATCHES_ALONG).max(self.correlation_m),
            drawn: &self.drawn,
        }
    }
}

/// Position and size of a surface.
fn place_of_surface(surface: &SurfaceSamples) -> PartPlace {
    let sum: Vector3<f64> = surface.points.iter().map(|p| p.coords).sum();
    let middle = Point3::from(sum / surface.points.len().max(1) as f64);
    let radius_m = surface.points.iter().map(|p| (p - middle).norm()).fold(0.0, f64::max);
    PartPlace { middle, radius_m }
}
