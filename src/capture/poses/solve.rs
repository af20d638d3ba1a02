//! Gauss-Newton for the poses of all states and the errors of their sensor, with the sizes of both.
//!
//! The states share only the sensor: each state's poses are eliminated (Schur complement), and its
//! information about the sensor is added up.

use std::{borrow::Cow, slice};

use nalgebra::{DMatrix, DVector, Vector3};
use rayon::prelude::*;

use super::{
    drift::{Drift, PoseErrors, growth_of_deviation, half_log_determinant},
    error_draw::{Drawn, drawn_errors},
    inverse::inverse_by_factor,
    pairs::{Comparison, Fit, Matches, PairSums, Sums, Views},
    sensor_errors::SensorErrors,
    sensor_sums::SensorSums,
    surfels::Surfels,
    trajectory::Trajectory,
};
use common::stop::{Stop, Stopped};
use geometry::{Pose, log_so3};

/// Most rounds of association and Gauss-Newton, by update of the error sizes.
const ROUNDS: [usize; 3] = [10, 3, 3];
/// Most rounds per update of the error sizes.
const SIZES: usize = 12;
/// Share of the expected displacement that counts as noise, in the first rounds.
/// chosen: falls slowly enough for associations to follow
pub(super) const LOOSE: [f64; 5] = [1.0, 0.5, 0.3, 0.2, 0.1];
/// Rounds end when all camera motions are smaller, meters (radians times one meter).
/// chosen: far below the error of poses
pub(super) const STEP_M: f64 = 5e-5;
/// Prior standard deviation of the smooth depth errors (see `sensor_errors`) ... chosen: of the order that
/// calibrations leave (docs/method.md 2.11)
const WARP: f64 = 0.004;
/// ... and its lower bound, as no variance may be zero. chosen: far below any sensor's
const LEAST_WARP: f64 = 1e-6;

/// A state with poses to be solved for.
pub(super) struct Problem<'a> {
    comparison: Comparison,
    /// Surfels of its frames, as read.
    pub surfels: &'a [Surfels],
    pub reported: Vec<Pose>,
    /// Whether the poses were tracked in the same frames: then the residuals do not show the size of their
    /// errors, and it stays at the prior.
    pub tracked: bool,
    drift: Drift,
    /// Derivative of the corrections by the delay of the poses: the camera velocities in their own frames,
    /// m/s and rad/s.
    velocities: DVector<f64>,
    stop: Stop,
}

/// The solution.
pub(super) struct Solution {
    /// Poses by state.
    pub poses: Vec<Vec<Pose>>,
    pub errors: Vec<PoseErrors>,
    pub sensor: Option<Sensor>,
    /// Draws of the remaining errors.
    pub draws: Vec<Drawn>,
}

/// The sensor's estimated errors.
pub(super) struct Sensor {
    pub errors: SensorErrors,
    /// Covariance of their parameters.
    pub covariance: DMatrix<f64>,
}

/// Sizes of pose and sensor errors.
#[derive(Clone)]
struct Sizes {
    poses: Vec<PoseErrors>,
    warp: f64,
}

/// A Gauss-Newton step with its covariance.
struct Step {
    poses: Vec<DVector<f64>>,
    /// By state, covariance of the corrections without the part of the delay.
    pose_covariances: Vec<DMatrix<f64>>,
    /// By state, covariance of the poses for a known sensor, and their derivative by it.
    own: Vec<[DMatrix<f64>; 2]>,
    sensor: DVector<f64>,
    sensor_covariance: DMatrix<f64>,
    /// By state, information of the prior.
    pose_information: Vec<DMatrix<f64>>,
    sensor_information: DMatrix<f64>,
    /// Log marginal likelihood of the sizes, up to a constant.
    log_likelihood: f64,
}

impl<'a> Problem<'a> {
    /// For the frames of a state, in order of time.
    pub fn new(
        surfels: &'a [Surfels],
        matches: Matches,
        reported: &Trajectory,
        tracked: bool,
        stop: &Stop,
    ) -> Self {
        let velocities = reported.velocities();
        let reported = reported.poses.clone();
        let count = reported.len();
        let pairs = (0..count).flat_map(|i| (0..count).filter(move |j| *j != i).map(move |j| [i, j]));
        let expected = PoseErrors::EXPECTED.jitter;
        let comparison = Comparison::new(surfels.iter(), pairs.collect(), matches, expected, stop);
        Self {
            comparison: comparison.coarse_while_loose(),
            surfels,
            drift: Drift::along_poses(&[&reported]),
            reported,
            tracked,
            velocities,
            stop: stop.clone(),
        }
    }

    /// Its surfels and poses as reported.
    pub fn as_reported(&self) -> Views<'_> {
        Views { surfels: self.surfels, world_from_camera: &self.reported }
    }

    pub fn comparison(&self) -> &Comparison {
        &self.comparison
    }

    /// Its surfels with depth corrected by the sensor; as read without one.
    pub fn corrected_surfels(&self, sensor: Option<&SensorErrors>) -> Cow<'a, [Surfels]> {
        sensor
            .map_or(Cow::Borrowed(self.surfels), |errors| Surfels::all_corrected(self.surfels, errors).into())
    }
}

/// Corrections of reported poses so far, six values per camera.
pub(super) fn corrections(reported: &[Pose], poses: &[Pose]) -> DVector<f64> {
    let all = reported.iter().zip(poses).flat_map(|(reported, pose)| {
        let [moved, turned] = correction_of_pose(reported, pose);
        [moved.x, moved.y, moved.z, turned.x, turned.y, turned.z]
    });
    DVector::from_iterator(6 * poses.len(), all)
}

/// Poses moved by a step, six values per camera in its own frame.
pub(super) fn moved_poses(poses: &[Pose], step: &DVector<f64>) -> Vec<Pose> {
    let steps = step.as_slice().chunks_exact(6);
    // Applied from the right, since corrections are in the cameras' frames.
    let moved = poses
        .iter()
        .zip(steps)
        .map(|(pose, s)| pose * Pose::new(Vector3::new(s[0], s[1], s[2]), Vector3::new(s[3], s[4], s[5])));
    moved.collect()
}

/// The most likely poses of all states, and the sizes of the errors of the reported ones; with the sensor's
/// errors if they are given as a start.
///
/// # Errors
/// [`Stopped`].
pub(super) fn most_likely_poses(
    problems: &[&Problem<'_>],
    sensor: Option<SensorErrors>,
) -> Result<Option<Solution>, Stopped> {
    let mut sensor = sensor.map(|errors| {
        let count = errors.count();
        Sensor { errors, covariance: DMatrix::zeros(count, count) }
    });
    let mut poses: Vec<Vec<Pose>> = problems.iter().map(|p| p.reported.clone()).collect();
    let mut sizes = Sizes { poses: starting_sizes(problems, PoseErrors::EXPECTED), warp: WARP };
    let mut scales: Vec<f64> = problems
        .iter()
        .map(|p| p.comparison.residual_scale(p.as_reported()))
        .collect::<Result<_, Stopped>>()?;
    let mut loosened = LOOSE.into_iter();
    let mut found = None;
    for (stage, rounds) in ROUNDS.into_iter().enumerate() {
        let mut last = None;
        for _ in 0..rounds {
            let loose = loosened.next();
            let known = sensor.as_ref().map(|s| &s.errors);
            // In parallel, so that no state waits for another.
            let sums: Vec<Sums> = problems
                .par_iter()
                .zip(&poses)
                .zip(&scales)
                .map(|((p, poses), &scale)| {
                    let corrected = p.corrected_surfels(known);
                    let views = Views { surfels: &corrected, world_from_camera: poses };
                    let fit = Fit { loose: loose.unwrap_or(0.0), is_rough: stage == 0 };
                    p.comparison.normal_equations(views, known, scale, fit)
                })
                .collect::<Result<_, Stopped>>()?;
            scales = sums.iter().map(|s| s.scale).collect();
            let at: Vec<DVector<f64>> =
                problems.iter().zip(&poses).map(|(p, poses)| corrections(&p.reported, poses)).collect();
            let Some(step) = likeliest_step(problems, &sums, &at, known, &sizes) else {
                return unsolved(problems);
            };
            let mut longest = 0.0f64;
            for (poses, step) in poses.iter_mut().zip(&step.poses) {
                *poses = moved_poses(poses, step);
                longest = longest.max(step.amax());
            }
            if let Some(sensor) = &mut sensor {
                sensor.errors.add_step(&step.sensor);
                sensor.covariance = step.sensor_covariance.clone();
                longest = longest.max(step.sensor.amax());
            }
            last = Some((sums, at, step));
            // With a loose gate, the next round solves different equations.
            if loose.is_none() && longest < STEP_M {
                break;
            }
        }
        if let Some((sums, at, step)) = last {
            let known = sensor.as_ref().map(|s| &s.errors);
            sizes = match most_likely(problems, &sums, &at, known, &sizes) {
                Some(likely) => likely,
                None => return unsolved(problems),
            };
            found = Some(step);
        }
    }
    let draws = found.and_then(|found| drawn_errors(&found.own, &found.sensor_covariance));
    Ok(draws.map(|draws| Solution { poses, errors: sizes.poses, sensor, draws }))
}

/// No solution: too little is seen, or it was stopped.
fn unsolved(problems: &[&Problem<'_>]) -> Result<Option<Solution>, Stopped> {
    problems.iter().try_for_each(|p| p.stop.check())?;
    Ok(None)
}

/// The step from the normal equations of all states; `None` also when stopped.
fn likeliest_step(
    problems: &[&Problem<'_>],
    sums: &[Sums],
    at: &[DVector<f64>],
    sensor: Option<&SensorErrors>,
    sizes: &Sizes,
) -> Option<Step> {
    let values = sensor.map_or_else(|| DVector::zeros(0), SensorErrors::values);
    let lag = sensor.map(SensorErrors::lag_index);
    let lag_s = sensor.map_or(0.0, |s| s.lag_s);
    let (sensor_information, half_log) = match sensor {
        Some(errors) => sensor_information(errors, sizes.warp)?,
        None => (DMatrix::zeros(0, 0), 0.0),
    };
    let mut information = sensor_information.clone();
    let mut gradient = &sensor_information * &values;
    let mut log_likelihood = half_log - 0.5 * values.dot(&gradient);
    let mut whole_gradient = gradient.clone();
    // By state: covariance of the poses for a known sensor, their derivative by the sensor, their own step,
    // and the gradient.
    let mut eliminated = Vec::new();
    let mut pose_information = Vec::new();
    for (((problem, sums), at), errors) in problems.iter().zip(sums).zip(at).zip(&sizes.poses) {
        problem.stop.check().ok()?;
        let (prior, half_log) = problem.drift.information(slice::from_ref(errors))?;
        let (mut own, mut own_gradient) = pose_equations(&sums.pairs, at.len() / 6);
        own += &prior;
        // The prior is centered on the reported poses at the image times.
        let away = at - &problem.velocities * lag_s;
        let pull = &prior * &away;
        own_gradient += &pull;
        let factor = own.cholesky()?;
        log_likelihood += half_log - half_log_determinant(&factor) - 0.5 * away.dot(&pull);
        let covariance = inverse_by_factor(&factor);
        let own_step = &covariance * &own_gradient;
        let follow = match &sums.sensor {
            Some(of_state) => {
                let SensorSums { information: of_state, between, gradient: of_sensor } =
                    with_lag(of_state, lag?, &problem.velocities, &prior, &pull);
                let follow = &covariance * &between;
                // Schur complement: the state's information about the sensor once its poses are eliminated.
                information += of_state - between.transpose() * &follow;
                gradient += &of_sensor - between.transpose() * &own_step;
                whole_gradient += of_sensor;
                follow
            }
            None => DMatrix::zeros(at.len(), values.len()),
        };
        pose_information.push(prior);
        eliminated.push((covariance, follow, own_step, own_gradient));
    }
    let sensor_covariance = if sensor.is_some() {
        let factor = information.cholesky()?;
        log_likelihood -= half_log_determinant(&factor);
        inverse_by_factor(&factor)
    } else {
        information
    };
    let sensor = -(&sensor_covariance * gradient);
    // Half of the reduction of the squares by the step; each state's part is added below.
    log_likelihood -= 0.5 * whole_gradient.dot(&sensor);
    let mut poses = Vec::new();
    let mut pose_covariances = Vec::new();
    let mut own = Vec::new();
    for ((covariance, follow, own_step, own_gradient), problem) in eliminated.into_iter().zip(problems) {
        // Back substitution: the sensor's uncertainty adds to the poses'.
        let step = -own_step - &follow * &sensor;
        log_likelihood -= 0.5 * own_gradient.dot(&step);
        poses.push(step);
        let rest = beside_lag(&follow, lag, &problem.velocities);
        pose_covariances.push(&covariance + &rest * &sensor_covariance * rest.transpose());
        own.push([covariance, follow]);
    }
    Some(Step {
        poses,
        pose_covariances,
        own,
        sensor,
        sensor_covariance,
        pose_information,
        sensor_information,
        log_likelihood,
    })
}

/// Derivative of the corrections by the sensor, without the part of the delay at index `lag`.
fn beside_lag(follow: &DMatrix<f64>, lag: Option<usize>, velocities: &DVector<f64>) -> DMatrix<f64> {
    let mut rest = follow.clone();
    if let Some(lag) = lag {
        let mut of_lag = rest.column_mut(lag);
        of_lag += velocities;
    }
    rest
}

/// The sums of a state with those of the delay, which enters only by the prior of the poses:
/// docs/method.md (2.23).
fn with_lag(
    sums: &SensorSums,
    lag: usize,
    velocities: &DVector<f64>,
    prior: &DMatrix<f64>,
    pull: &DVector<f64>,
) -> SensorSums {
    let SensorSums { mut information, mut between, mut gradient } = sums.clone();
    let carried = prior * velocities;
    information[(lag, lag)] += velocities.dot(&carried);
    between.set_column(lag, &-carried);
    gradient[lag] -= velocities.dot(pull);
    SensorSums { information, between, gradient }
}

/// Normal equations about the poses of a state.
pub(super) fn pose_equations(pairs: &[PairSums], poses: usize) -> (DMatrix<f64>, DVector<f64>) {
    let mut information = DMatrix::zeros(6 * poses, 6 * poses);
    let mut gradient = DVector::zeros(6 * poses);
    for sums in pairs {
        let [i, j] = sums.frames.map(|f| 6 * f);
        let [own, between, other] = sums.information;
        for (r, c, block) in [(i, i, own), (i, j, between), (j, i, between.transpose()), (j, j, other)] {
            let mut place = information.fixed_view_mut::<6, 6>(r, c);
            place += block;
        }
        for (at, g) in [i, j].into_iter().zip(sums.gradient) {
            let mut place = gradient.fixed_rows_mut::<6>(at);
            place += g;
        }
    }
    (information, gradient)
}

/// Prior information about the sensor's errors (scale and smooth errors), and half its log determinant.
fn sensor_information(errors: &SensorErrors, size: f64) -> Option<(DMatrix<f64>, f64)> {
    let factor = errors.expected_covariance(size).cholesky()?;
    Some((inverse_by_factor(&factor), -half_log_determinant(&factor)))
}

/// The most likely error sizes at the last linearization: with drift of the poses where it is likelier than
/// jitter alone by docs/method.md (1.6). See docs/method.md (2.15).
fn most_likely(
    problems: &[&Problem<'_>],
    sums: &[Sums],
    at: &[DVector<f64>],
    sensor: Option<&SensorErrors>,
    before: &Sizes,
) -> Option<Sizes> {
    let (still, drifting) = rayon::join(
        || settled_sizes(problems, sums, at, sensor, before, PoseErrors::WITHOUT_DRIFT),
        || settled_sizes(problems, sums, at, sensor, before, PoseErrors::EXPECTED),
    );
    let (still, likelihood_of_still) = still?;
    let (drifting, likelihood_of_drifting) = drifting?;
    // Drift has two sizes per state; each pose gives three values of either.
    let price: f64 = at.iter().map(|at| (at.len() as f64 / 2.0).ln()).sum();
    Some(if likelihood_of_drifting > likelihood_of_still + price { drifting } else { still })
}

/// Start values for the sizes of the pose errors.
fn starting_sizes(problems: &[&Problem<'_>], errors: PoseErrors) -> Vec<PoseErrors> {
    problems.iter().map(|p| if p.tracked { PoseErrors::TRACKED } else { errors }).collect()
}

/// Sizes estimated from a start, and their log likelihood. Associations and weights stay fixed, so a round
/// costs a factorization and no search.
fn settled_sizes(
    problems: &[&Problem<'_>],
    sums: &[Sums],
    at: &[DVector<f64>],
    sensor: Option<&SensorErrors>,
    before: &Sizes,
    start: PoseErrors,
) -> Option<(Sizes, f64)> {
    let mut sizes = Sizes { poses: starting_sizes(problems, start), ..before.clone() };
    for _ in 0..SIZES {
        sizes = resized_errors(
            problems,
            at,
            sensor,
            &likeliest_step(problems, sums, at, sensor, &sizes)?,
            &sizes,
        );
        if start == PoseErrors::WITHOUT_DRIFT {
            sizes.poses.iter_mut().for_each(|p| p.walk = start.walk);
        }
    }
    let likelihood = likeliest_step(problems, sums, at, sensor, &sizes)?.log_likelihood;
    Some((sizes, likelihood))
}

/// Update of the sizes from the estimates and their covariance. See docs/method.md (2.15).
fn resized_errors(
    problems: &[&Problem<'_>],
    at: &[DVector<f64>],
    sensor: Option<&SensorErrors>,
    step: &Step,
    sizes: &Sizes,
) -> Sizes {
    let lag_s = sensor.map_or(0.0, |s| s.lag_s + step.sensor[s.lag_index()]);
    let mut poses = sizes.poses.clone();
    for (k, problem) in problems.iter().enumerate().filter(|(_, problem)| !problem.tracked) {
        let mean = &at[k] + &step.poses[k] - &problem.velocities * lag_s;
        let information = &step.pose_information[k];
        poses[k] =
            problem.drift.likelier_sizes(&sizes.poses[k], information, &mean, &step.pose_covariances[k]);
    }
    Sizes { poses, warp: sensor.map_or(sizes.warp, |errors| resized_warp(sizes.warp, errors, step)) }
}

/// As in docs/method.md (2.15), with a single size for all coefficients of the warp.
fn resized_warp(size: f64, errors: &SensorErrors, step: &Step) -> f64 {
    let mean = errors.values() + &step.sensor;
    let information = &step.sensor_information;
    let pull = information * mean;
    let marginal = information - information * &step.sensor_covariance * information;
    let smooth = errors.warp.smooth_covariance();
    let count = errors.first_of_shift();
    let pull = pull.rows(0, count);
    let marginal = marginal.view((0, 0), (count, count));
    let change = growth_of_deviation(pull.dot(&(&smooth * pull)), smooth.dot(&marginal));
    (size * change).max(LEAST_WARP)
}

/// Translation, meters, and rotation vector, radians, of a correction in the camera's frame.
pub(super) fn correction_of_pose(reported: &Pose, pose: &Pose) -> [Vector3<f64>; 2] {
    let change = reported.inverse() * pose;
    [change.translation.vector, log_so3(&change.rotation)]
}
