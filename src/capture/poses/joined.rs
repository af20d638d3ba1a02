//! Poses of all states by what stands still across them.
//!
//! Views of a state may agree with each other and be bent all the same: where they share faces of one
//! direction only, nothing holds those from the left against those from the right. Views of another state
//! see the same surfaces. See docs/method.md 2.8.

use std::mem;

use nalgebra::{DMatrix, DVector, Vector6};
use tracing::debug;

use super::{
    PoseFindings,
    drift::{Drift, PoseErrors},
    error_draw::{ErrorDraw, drawn_errors},
    inverse::inverse_by_factor,
    pairs::{Comparison, Fit, Gain, Matches, Views},
    pose_noise::PoseNoise,
    sensor_errors::SensorErrors,
    solve::{LOOSE, STEP_M, corrections, moved_poses, pose_equations},
    surfels::Surfels,
};
use common::stop::{Stop, Stopped};
use geometry::Pose;

/// Most rounds of association and Gauss-Newton.
const ROUNDS: usize = 12;
/// Number of the first shares of [`LOOSE`] that are left out, as the poses are near already.
const NEAR: usize = 3;

/// The views of all states, in the world of state 0 and in the order of the states.
pub(super) struct Joined {
    pub surfels: Vec<Surfels>,
    /// Poses by state, as reported.
    pub reported: Vec<Vec<Pose>>,
    /// Poses as found for each state alone.
    pub found: Vec<Pose>,
    /// Matches within the states and between them.
    pub matches: Matches,
    /// Sizes of the errors of each state's poses.
    pub errors: Vec<PoseErrors>,
}

/// The poses of all views, and draws of their errors.
pub(super) struct JoinedPoses {
    pub poses: Vec<Pose>,
    /// By draw, the remaining error of each view's pose.
    pub draws: Vec<Vec<Vector6<f64>>>,
}

/// The sizes of each state's pose errors, and the reported poses brought to rest on state 0; `None` where a
/// state was not corrected or not brought to rest, and for a single state.
pub(super) fn at_rest(
    findings: &PoseFindings,
    mut reported: Vec<Vec<Pose>>,
) -> Option<(Vec<PoseErrors>, Vec<Vec<Pose>>)> {
    if reported.len() < 2 {
        return None;
    }
    let corrections = findings.states.iter().map(|state| state.as_ref().filter(|state| state.used));
    let errors: Vec<PoseErrors> = corrections.map(|c| c.map(|c| c.errors)).collect::<Option<_>>()?;
    for (poses, world) in reported.iter_mut().skip(1).zip(&findings.worlds) {
        let correction = world.as_ref()?.corrected_from_reported;
        poses.iter_mut().for_each(|pose| *pose = correction * *pose);
    }
    Some((errors, reported))
}

/// Matches between views of all states, from those within each state, by the views of the state, and those
/// between state 0 and each further one, by the views of both.
pub(super) fn all_matches(
    within: Vec<Matches>,
    with_first: impl Iterator<Item = Matches>,
    counts: &[usize],
) -> Matches {
    let first_of = |s: usize| counts[..s].iter().sum::<usize>();
    let mut all = Matches::new();
    for (s, own) in within.into_iter().enumerate() {
        all.extend(own.into_iter().map(|(pair, list)| (pair.map(|i| first_of(s) + i), list)));
    }
    for (s, between) in (1..).zip(with_first) {
        let behind = first_of(s) - counts[0];
        let view = |i: usize| if i < counts[0] { i } else { behind + i };
        all.extend(between.into_iter().map(|(pair, list)| (pair.map(view), list)));
    }
    all
}

impl Joined {
    /// The most likely poses of all views, with draws of their errors, each beside a draw of the sensor's;
    /// `None` where held-out surfels do not agree better.
    ///
    /// # Errors
    /// [`Stopped`].
    pub fn most_likely_poses(
        mut self,
        draws: &[ErrorDraw],
        stop: &Stop,
    ) -> Result<Option<JoinedPoses>, Stopped> {
        let Some(first) = self.surfels.first() else { return Ok(None) };
        let states: Vec<&[Pose]> = self.reported.iter().map(Vec::as_slice).collect();
        let Some((prior, _)) = Drift::along_poses(&states).information(&self.errors) else {
            return Ok(None);
        };
        let reported = states.concat();
        let count = reported.len();
        let pairs = (0..count).flat_map(|i| (0..count).filter(move |j| *j != i).map(move |j| [i, j]));
        let matches = mem::take(&mut self.matches);
        let expected = PoseNoise::EXPECTED;
        let comparison = Comparison::new(self.surfels.iter(), pairs.collect(), matches, expected, stop);
        let before = self.seen_from(&self.found);
        let mut scale = comparison.residual_scale(before)?;
        let mut poses = self.found.clone();
        for round in 0..ROUNDS {
            stop.check()?;
            let loose = LOOSE.get(NEAR + round).copied();
            let fit = Fit::loose(loose.unwrap_or(0.0));
            let sums = comparison.normal_equations(self.seen_from(&poses), None, scale, fit)?;
            scale = sums.scale;
            let (information, gradient) = pose_equations(&sums.pairs, count);
            let gradient = gradient + &prior * corrections(&reported, &poses);
            let Some(factor) = (information + &prior).cholesky() else { return Ok(None) };
            let step = -factor.solve(&gradient);
            poses = moved_poses(&poses, &step);
            if loose.is_none() && step.amax() < STEP_M {
                break;
            }
        }
        let after = self.seen_from(&poses);
        let changes = comparison.changes_between(before, after)?;
        let Some(Gain { sigmas, residual_m: [before_m, after_m] }) = Gain::of_changes(&[changes]) else {
            return Ok(None);
        };
        debug!(sigmas, before_m, after_m, "gain of the views of all states");
        if sigmas <= 0.0 {
            return Ok(None);
        }
        // All states share the sensor, whose errors their poses follow.
        let sensor = SensorErrors::without_errors(first.intrinsics());
        let sums = comparison.normal_equations(after, Some(&sensor), scale, Fit::CLOSE)?;
        let (information, _) = pose_equations(&sums.pairs, count);
        let Some(factor) = (information + prior).cholesky() else { return Ok(None) };
        let covariance = inverse_by_factor(&factor);
        let follow = sums.sensor.map(|sensor| &covariance * sensor.between);
        let unknown_sensor = [covariance, DMatrix::zeros(6 * count, 0)];
        let Some(own) = drawn_errors(&[unknown_sensor], &DMatrix::zeros(0, 0)) else { return Ok(None) };
        let mut joined = Vec::with_capacity(draws.len());
        for (own, draw) in own.into_iter().zip(draws) {
            let mut errors: Vec<Vector6<f64>> = own.poses.into_iter().flatten().collect();
            if let (Some(follow), Some(warp)) = (&follow, &draw.warp) {
                let values = DVector::from_column_slice(&warp.values);
                let followed = follow.columns(0, values.len()) * values;
                let of_views = followed.as_slice().chunks_exact(6);
                errors.iter_mut().zip(of_views).for_each(|(e, f)| *e -= Vector6::from_column_slice(f));
            }
            joined.push(errors);
        }
        Ok(Some(JoinedPoses { poses, draws: joined }))
    }

    fn seen_from<'a>(&'a self, poses: &'a [Pose]) -> Views<'a> {
        Views { surfels: &self.surfels, world_from_camera: poses }
    }
}
