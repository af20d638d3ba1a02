//! Motion between the world frames of two states, from surfaces that are static across them.

use std::fmt;

use nalgebra::{DVector, Matrix6, Matrix6xX, Point3, Vector3, Vector6};
use rayon::prelude::*;

use serde::{Deserialize, Serialize};

use super::{
    drift::adjoint,
    error_draw::ErrorDraw,
    observed::Observed,
    pairs::{Comparison, Fit, Gain, Matches, PairSums, Views},
    pose_noise::PoseNoise,
    sensor_errors::SensorErrors,
    sensor_sums::SensorSums,
    solve::LOOSE,
    surfels::Surfels,
};
use crate::{NoiseConfig, RgbdFrame};
use common::stop::{Stop, Stopped};
use geometry::{Pose, log_so3, shift_and_turn};

/// Most rounds of association and Gauss-Newton.
const ROUNDS: usize = 12;
/// Rounds end with a smaller motion of the world, meters (radians times one meter).
/// chosen: far below the error of the world's pose
const STEP_M: f64 = 1e-5;

/// Correction of state 1's world frame by static surfaces.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorldCorrection {
    /// Multiplies the poses of state 1 from the left.
    pub corrected_from_reported: Pose,
    /// Displacement of the center of the observed surface, meters.
    pub moved_m: f64,
    /// Angle of the rotation, radians.
    pub turned_rad: f64,
    /// Robust standard deviation of held-out distances between surfaces of both states, before and after,
    /// meters.
    pub residual_m: [f64; 2],
    /// Covariance of a perturbation of `corrected_from_reported` from the left (translation, rotation),
    /// meters and radians squared; `None` for too few frames.
    pub covariance: Option<Matrix6<f64>>,
}

impl fmt::Display for WorldCorrection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [before_mm, after_mm] = self.residual_m.map(|m| 1e3 * m);
        let mm = 1e3 * self.moved_m;
        let deg = self.turned_rad.to_degrees();
        write!(
            f,
            "moved by {mm:.2} mm and {deg:.3} deg onto what stands still; surfaces that its frames and those \
             of state 0 "
        )?;
        write!(f, "share lay {before_mm:.2} mm apart, now {after_mm:.2} mm")
    }
}

/// The correction of the second state's world frame by static surfaces, with prior `expected`; `only_object`
/// restricts it to surfaces of the object. `None` if held-out surfels do not agree better.
///
/// # Errors
/// [`Stopped`].
pub fn align_worlds(
    states: [&[RgbdFrame]; 2],
    noise: &NoiseConfig,
    expected: &PoseNoise,
    only_object: bool,
    stop: &Stop,
) -> Result<Option<WorldCorrection>, Stopped> {
    let surfels =
        [surfels_of(states[0], noise, only_object, stop)?, surfels_of(states[1], noise, only_object, stop)?];
    let poses = states.map(poses_of);
    let poses = poses.each_ref().map(Vec::as_slice);
    let found =
        corrected_world(poses, surfels.each_ref().map(Vec::as_slice), Matches::new(), expected, stop)?;
    Ok(found.map(|(world, _)| world))
}

/// Surfels of each frame; `only_object` restricts them to the object.
fn surfels_of(
    frames: &[RgbdFrame],
    noise: &NoiseConfig,
    only_object: bool,
    stop: &Stop,
) -> Result<Vec<Surfels>, Stopped> {
    let frames = frames.par_iter();
    frames
        .map(|f| {
            stop.check()?;
            Ok(Surfels::of_frame(f, noise, |pixel| !only_object || f.is_object(pixel)))
        })
        .collect()
}

/// Reported poses of frames.
pub(super) fn poses_of(frames: &[RgbdFrame]) -> Vec<Pose> {
    frames.iter().map(|f| f.world_from_camera).collect()
}

/// Poses of both states, with those from `first` on moved about a center.
fn second_state_moved(reported: &[Pose], first: usize, from_center: &Pose, moved: &Pose) -> Vec<Pose> {
    let world = from_center * moved * from_center.inverse();
    reported.iter().enumerate().map(|(i, p)| if i < first { *p } else { world * p }).collect()
}

/// The same from surfels and poses of both states; see [`align_worlds`].
pub(crate) fn corrected_world(
    states: [&[Pose]; 2],
    surfels: [&[Surfels]; 2],
    matches: Matches,
    expected: &PoseNoise,
    stop: &Stop,
) -> Result<Option<(WorldCorrection, Follow)>, Stopped> {
    let first = states[0].len();
    let count = states[0].len() + states[1].len();
    // Pairs across the states only, as the motion changes nothing within a state.
    let pairs = (0..count)
        .flat_map(|i| (0..count).filter(move |j| (i < first) != (*j < first)).map(move |j| [i, j]))
        .collect();
    let all: Vec<Surfels> = surfels.into_iter().flatten().cloned().collect();
    let comparison = Comparison::new(all.iter(), pairs, matches, *expected, stop);
    fn seen_from<'a>(surfels: &'a [Surfels], world_from_camera: &'a [Pose]) -> Views<'a> {
        Views { surfels, world_from_camera }
    }
    let reported: Vec<Pose> = states.concat();
    let Some(center) = middle_of_surfels(&reported[first..], surfels[1]) else { return Ok(None) };
    let from_center = Pose::from_parts(center.coords.into(), nalgebra::UnitQuaternion::identity());
    // Motion about the center, so that undetermined motions stay small there.
    let mut moved = Pose::identity();
    let mut scale = comparison.residual_scale(seen_from(&all, &reported))?;
    for round in 0..ROUNDS {
        let poses = second_state_moved(&reported, first, &from_center, &moved);
        let sums = comparison.normal_equations(
            seen_from(&all, &poses),
            None,
            scale,
            Fit::loose(LOOSE.get(round).copied().unwrap_or(0.0)),
        )?;
        scale = sums.scale;
        let step = world_step(&sums.pairs, &poses, first, &from_center, &moved, expected);
        let Some(step) = step else { return Ok(None) };
        moved = Pose::new(step.fixed_rows::<3>(0).into(), step.fixed_rows::<3>(3).into()) * moved;
        if round >= LOOSE.len() && step.amax() < STEP_M {
            break;
        }
    }
    let poses = second_state_moved(&reported, first, &from_center, &moved);
    let changes = comparison.changes_between(seen_from(&all, &reported), seen_from(&all, &poses))?;
    let Some(Gain { sigmas, residual_m }) = Gain::of_changes(&[changes]) else { return Ok(None) };
    if sigmas <= 0.0 {
        return Ok(None);
    }
    // Both states share the sensor and its error at each pixel.
    let Some(of_first) = surfels[0].first() else { return Ok(None) };
    let sensor = SensorErrors::without_errors(of_first.intrinsics());
    let sums = comparison.normal_equations(seen_from(&all, &poses), Some(&sensor), scale, Fit::CLOSE)?;
    let pairs: Vec<PairInformation> =
        sums.pairs.iter().map(|s| PairInformation::of_pair(s, &poses, first, &from_center)).collect();
    let covariance = world_covariance(&pairs, [first, count - first], expected).map(|about_center| {
        // Callers use motions about the world's origin.
        let at_origin = adjoint(&from_center);
        at_origin * about_center * at_origin.transpose()
    });
    let world = WorldCorrection {
        covariance,
        corrected_from_reported: from_center * moved * from_center.inverse(),
        moved_m: moved.translation.vector.norm(),
        turned_rad: log_so3(&moved.rotation).norm(),
        residual_m,
    };
    let follow = sums.sensor.and_then(|s| Follow::new(&pairs, &s, &poses, first, &from_center, expected));
    Ok(follow.map(|follow| (world, follow)))
}

/// Derivatives of state 1's world correction by the errors of poses and depth in the frames it was computed
/// from. See docs/method.md 2.12.
pub(crate) struct Follow {
    /// Derivatives of the motion about the center by a motion of each frame ...
    by_frame: Vec<Matrix6<f64>>,
    /// ... and by the sensor's errors.
    by_sensor: Matrix6xX<f64>,
    /// Motion about the center, expressed in the frame of each camera of state 1.
    carried: Vec<Matrix6<f64>>,
}

impl Follow {
    fn new(
        pairs: &[PairInformation],
        sensor: &SensorSums,
        poses: &[Pose],
        first: usize,
        from_center: &Pose,
        expected: &PoseNoise,
    ) -> Option<Self> {
        let Observed { information, projector } =
            Observed::of_information(&pairs.iter().map(|p| p.information).sum());
        let response = -(information + expected_information(expected)).cholesky()?.inverse() * projector;
        let mut by_frame = vec![Matrix6::zeros(); poses.len()];
        for pair in pairs {
            pair.frames.iter().zip(pair.by_frame).for_each(|(&f, by)| by_frame[f] += response * by);
        }
        let carried: Vec<Matrix6<f64>> =
            poses[first..].iter().map(|pose| adjoint(&(pose.inverse() * from_center))).collect();
        let mut by_sensor = Matrix6xX::zeros(sensor.between.ncols());
        for (k, carried) in carried.iter().enumerate() {
            by_sensor += response * carried.transpose() * sensor.between.fixed_rows::<6>(6 * (first + k));
        }
        Some(Self { by_frame, by_sensor, carried })
    }

    /// Adds the resulting world motion to the second state's errors in a draw. See docs/method.md (2.25).
    pub fn apply_to_draw(&self, [first, second]: [usize; 2], draw: &mut ErrorDraw) {
        let of_frames = draw.poses[first].iter().chain(&draw.poses[second]);
        let mut world: Vector6<f64> = of_frames.zip(&self.by_frame).map(|(error, by)| by * error).sum();
        if let Some(warp) = &draw.warp {
            let values = DVector::from_column_slice(&warp.values);
            world += self.by_sensor.columns(0, values.len()) * values;
        }
        draw.poses[second]
            .iter_mut()
            .zip(&self.carried)
            .for_each(|(error, carried)| *error += carried * world);
    }
}

/// Information of a frame pair about state 1's motion about the center: translation and rotation, from the
/// left.
struct PairInformation {
    frames: [usize; 2],
    information: Matrix6<f64>,
    gradient: Vector6<f64>,
    /// Derivative of the gradient by a motion of either camera.
    by_frame: [Matrix6<f64>; 2],
}

impl PairInformation {
    fn of_pair(sums: &PairSums, poses: &[Pose], first: usize, from_center: &Pose) -> Self {
        // Index of the camera of state 1 in the pair.
        let which = usize::from(sums.frames[0] < first);
        // The world's motion, in the frame of the camera it moves.
        let carried = adjoint(&(poses[sums.frames[which]].inverse() * from_center));
        let [own, between, other] = sums.information;
        let by_frame = if which == 0 { [own, between] } else { [between.transpose(), other] };
        Self {
            by_frame: by_frame.map(|by| carried.transpose() * by),
            frames: sums.frames,
            information: carried.transpose() * sums.information[2 * which] * carried,
            gradient: carried.transpose() * sums.gradient[which],
        }
    }
}

/// One step of the motion about the center: translation and rotation, from the left.
fn world_step(
    sums: &[PairSums],
    poses: &[Pose],
    first: usize,
    from_center: &Pose,
    moved: &Pose,
    expected: &PoseNoise,
) -> Option<Vector6<f64>> {
    let mut information = Matrix6::zeros();
    let mut gradient = Vector6::zeros();
    for pair in sums.iter().map(|s| PairInformation::of_pair(s, poses, first, from_center)) {
        information += pair.information;
        gradient += pair.gradient;
    }
    let Observed { information, projector } = Observed::of_information(&information);
    let expected = expected_information(expected);
    // Only the prior acts along undetermined directions.
    let gradient = projector * gradient + expected * shift_and_turn(moved);
    Some(-(information + expected).cholesky()?.solve(&gradient))
}

/// Covariance of the motion about the center. Depth and pose errors are correlated within a frame, so each
/// frame is one observation (cluster-robust: Liang and Zeger 1986); `None` if a state has no more frames than
/// parameters. See docs/method.md (2.17).
fn world_covariance(
    pairs: &[PairInformation],
    frames: [usize; 2],
    expected: &PoseNoise,
) -> Option<Matrix6<f64>> {
    const PARAMETERS: usize = 6;
    let Observed { information, projector } =
        Observed::of_information(&pairs.iter().map(|p| p.information).sum());
    let mut by_frame = vec![Vector6::zeros(); frames[0] + frames[1]];
    for pair in pairs {
        pair.frames.iter().for_each(|&f| by_frame[f] += projector * pair.gradient);
    }
    let expected = expected_information(expected);
    // The prior counts as one more, independent observation.
    let mut spread = expected;
    for (state, count) in frames.into_iter().enumerate() {
        let small_sample = count as f64 / count.checked_sub(PARAMETERS).filter(|n| *n > 0)? as f64;
        let own = by_frame.iter().skip(state * frames[0]).take(count);
        spread += own.map(|g| g * g.transpose()).sum::<Matrix6<f64>>() * small_sample;
    }
    let inverse = (information + expected).cholesky()?.inverse();
    Some(inverse * spread * inverse)
}

/// Information of the prior about the motion.
fn expected_information(expected: &PoseNoise) -> Matrix6<f64> {
    Matrix6::from_diagonal(&Vector6::from_fn(|k, _| {
        let sigma = if k < 3 { expected.translation_m } else { expected.rotation_rad };
        sigma.powi(-2)
    }))
}

/// Mean center of the surfels in the world; `None` without any.
fn middle_of_surfels(world_from_camera: &[Pose], surfels: &[Surfels]) -> Option<Point3<f64>> {
    let mut sum = Vector3::zeros();
    let mut count = 0.0;
    for (pose, surfels) in world_from_camera.iter().zip(surfels) {
        let (own, number) = surfels.sum_of_points();
        sum += pose.rotation * own + pose.translation.vector * number;
        count += number;
    }
    (count > 0.0).then(|| Point3::from(sum / count))
}
