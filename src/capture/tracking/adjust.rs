//! Joint adjustment of frame poses: Gauss-Newton over surfels and landmarks seen by pairs of frames.
//!
//! The equations are those of the correction of reported poses (docs/method.md 2.7), without its prior.
//! Undetermined directions keep their start values.

use nalgebra::{DMatrix, DVector, Matrix6, Vector3, Vector6};

use crate::poses::{
    pairs::{Comparison, Fit, Matches, PairSums, Views},
    pose_noise::PoseNoise,
    surfels::Surfels,
};
use common::stop::{Stop, Stopped};
use geometry::Pose;

/// By round, the share of the expected start error that counts as noise.
/// chosen: falls slowly enough for associations to follow
const LOOSE: [f64; 5] = [1.0, 0.5, 0.25, 0.1, 0.05];
/// Most rounds.
const ROUNDS: usize = 10;
/// Rounds end with a smaller motion, meters (radians times one meter).
/// chosen: a fifth of the error of one pose from a frame's surfels, 0.2 mm
const STEP_M: f64 = 4e-5;
/// Surfels compared per round and frame.
/// tuned: shared/bags; more changed no pose by a tenth of its deviation
const COMPARED: usize = 16_000;

/// Frames and pairs to adjust.
pub(super) struct Adjustment<'a> {
    pub surfels: &'a [Surfels],
    /// The first `fixed` frames keep their poses.
    pub fixed: usize,
    /// Pairs of frames with surface in common, each once.
    pub pairs: &'a [[usize; 2]],
    /// Matching landmarks of these pairs.
    pub matches: &'a Matches,
    /// Error of the start poses.
    pub start: PoseNoise,
    /// Checked in every round.
    pub stop: &'a Stop,
}

/// The adjusted poses.
pub(super) struct Adjusted {
    pub poses: Vec<Pose>,
    /// Normal equations of the ordered pairs at these poses.
    pub sums: Vec<PairSums>,
    /// Robust standard deviation of the normalized residuals, at least 1.
    pub scale: f64,
}

impl Adjustment<'_> {
    /// Adjusts the poses from a start; `None` if the equations cannot be solved.
    pub fn solve_near(&self, start: &[Pose]) -> Result<Option<Adjusted>, Stopped> {
        let mut pairs: Vec<[usize; 2]> = self.pairs.iter().flat_map(|[i, j]| [[*i, *j], [*j, *i]]).collect();
        pairs.sort_unstable();
        pairs.dedup();
        let mut matches = self.matches.clone();
        for ([i, j], found) in self.matches {
            matches.entry([*j, *i]).or_insert_with(|| found.iter().map(|[a, b]| [*b, *a]).collect());
        }
        let free = start.len() - self.fixed;
        let comparison = Comparison::new(self.surfels.iter(), pairs, matches, self.start, self.stop)
            .with_surfels(COMPARED * free.max(1));
        let mut poses = start.to_vec();
        let mut scale = comparison.residual_scale(self.seen_from(&poses))?;
        let mut sums = Vec::new();
        for round in 0..ROUNDS {
            let loose = LOOSE.get(round).copied().unwrap_or(0.0);
            let found =
                comparison.normal_equations(self.seen_from(&poses), None, scale, Fit::loose(loose))?;
            (scale, sums) = (found.scale, found.pairs);
            let Some(step) = self.step(&sums, start, &poses) else { return Ok(None) };
            for (k, pose) in poses[self.fixed..].iter_mut().enumerate() {
                *pose *=
                    Pose::new(step.fixed_rows::<3>(6 * k).into(), step.fixed_rows::<3>(6 * k + 3).into());
            }
            if round >= LOOSE.len() && step.amax() < STEP_M {
                break;
            }
        }
        Ok(Some(Adjusted { poses, sums, scale }))
    }

    fn seen_from<'b>(&'b self, poses: &'b [Pose]) -> Views<'b> {
        Views { surfels: self.surfels, world_from_camera: poses }
    }

    /// The step from the normal equations, six values per free frame.
    fn step(&self, sums: &[PairSums], start: &[Pose], poses: &[Pose]) -> Option<DVector<f64>> {
        let count = poses.len() - self.fixed;
        let mut information = DMatrix::zeros(6 * count, 6 * count);
        let mut gradient = DVector::zeros(6 * count);
        for pair in sums {
            let [i, j] = pair.frames.map(|frame| frame.checked_sub(self.fixed).map(|k| 6 * k));
            let [own, between, other] = pair.information;
            for (r, c, block) in [(i, i, own), (i, j, between), (j, i, between.transpose()), (j, j, other)] {
                if let (Some(r), Some(c)) = (r, c) {
                    let mut at = information.fixed_view_mut::<6, 6>(r, c);
                    at += block;
                }
            }
            for (at, g) in [i, j].into_iter().zip(pair.gradient) {
                if let Some(at) = at {
                    let mut at = gradient.fixed_rows_mut::<6>(at);
                    at += g;
                }
            }
        }
        // Only the prior at the start determines directions that the pairs leave undetermined.
        let known = Vector6::from_fn(|k, _| {
            let sigma = if k < 3 { self.start.translation_m } else { self.start.rotation_rad };
            (START_SPREAD * sigma).powi(-2)
        });
        for k in 0..count {
            let moved = start[self.fixed + k].inverse() * poses[self.fixed + k];
            let turn = moved.rotation.scaled_axis();
            let moved = moved.translation.vector;
            let away = Vector6::new(moved.x, moved.y, moved.z, turn.x, turn.y, turn.z);
            for i in 0..6 {
                information[(6 * k + i, 6 * k + i)] += known[i];
                gradient[6 * k + i] += known[i] * away[i];
            }
        }
        Some(-information.cholesky()?.solve(&gradient))
    }
}

/// Factor on the expected error of the start in its prior, which then matters only in undetermined
/// directions.
/// chosen: a hundredth of the weight of a reading
const START_SPREAD: f64 = 10.0;

impl Adjusted {
    /// Information of all pairs about the pose of a frame, in its camera's frame, with the other poses fixed.
    pub fn pose_information(&self, frame: usize) -> Matrix6<f64> {
        self.sums.iter().map(|s| information_of(s, frame)).sum()
    }

    /// The same from the pairs with one other frame.
    pub fn information_with(&self, frame: usize, other: usize) -> Matrix6<f64> {
        let between = self.sums.iter().filter(|s| s.frames.contains(&other));
        between.map(|s| information_of(s, frame)).sum()
    }
}

fn information_of(sums: &PairSums, frame: usize) -> Matrix6<f64> {
    let [own, _, other] = sums.information;
    match sums.frames {
        [i, _] if i == frame => own,
        [_, j] if j == frame => other,
        _ => Matrix6::zeros(),
    }
}

/// Standard deviation of points at a depth in front of a camera, in the least determined direction, meters.
/// See docs/method.md (2.27).
pub(super) fn least_known_m(information: &Matrix6<f64>, depth_m: f64) -> f64 {
    // Rotations in terms of the displacement at this depth.
    let scale = Vector6::from_fn(|k, _| if k < 3 { 1.0 } else { 1.0 / depth_m });
    let unit = Matrix6::from_diagonal(&scale);
    let least = (unit * information * unit).symmetric_eigenvalues().min();
    if least > 0.0 { least.powf(-0.5) } else { f64::INFINITY }
}

/// Information of matched landmarks about the second of two cameras, in its own frame.
pub(super) fn landmark_information(
    frames: [&Surfels; 2],
    matches: &[[u32; 2]],
    second_from_first: &Pose,
    noise: &PoseNoise,
) -> Matrix6<f64> {
    let mut sum = Matrix6::zeros();
    for &m in matches {
        for r in frames[0].landmark_residuals(m, frames[1], second_from_first, noise).into_iter().flatten() {
            let turn: Vector3<f64> = r.other_point.coords.cross(&r.other_normal);
            let n = r.other_normal;
            let row = Vector6::new(n.x, n.y, n.z, turn.x, turn.y, turn.z);
            sum += row * row.transpose() / r.sigma_m.powi(2);
        }
    }
    sum
}
