//! Keyframe poses from the relative poses of pairs (pose graph: Lu and Milios 1997).

use nalgebra::{DMatrix, DVector, Matrix6, Vector6};

use super::keyframes::KeyframeEdge;
use crate::poses::{drift::adjoint, pose_noise::PoseNoise};
use common::stop::{Stop, Stopped};
use geometry::{Pose, shift_and_turn};

/// Most rounds of Gauss-Newton.
const ROUNDS: usize = 24;
/// Initial factor on the squared residual at which pairs found by appearance lose half their weight; it falls
/// to a tenth every other round. Before a loop is closed, drift gives right pairs large residuals (graduated
/// non-convexity: Yang et al. 2020).
/// derived: meters against a millimeter, squared
const TRUSTED: f64 = 1e6;
/// Rounds end with a smaller motion, meters (radians times one meter).
/// chosen: a tenth of the error of poses afterwards
const STEP_M: f64 = 1e-5;
/// Least error of a relative pose, as a factor on the expected pose error: depth errors are correlated over
/// an image, which the information does not include.
/// measured: shared/bags/handheld, against ground truth
const FLOOR: f64 = 0.3;
/// Squared normalized residual at which a pair found by appearance has half its weight (Geman and McClure
/// 1985).
/// derived: six values of three standard deviations each
const DOUBTED: f64 = 54.0;

/// Poses that agree best with the pairs; the first one is fixed. `edges` refer to frames by index in `start`.
pub(super) fn pose_graph(start: &[Pose], edges: &[KeyframeEdge], stop: &Stop) -> Result<Vec<Pose>, Stopped> {
    let mut poses = start.to_vec();
    if poses.len() < 2 {
        return Ok(poses);
    }
    for round in 0..ROUNDS {
        stop.check()?;
        let trusted = (TRUSTED * 0.1f64.powi(round as i32 / 2)).max(1.0);
        let Some(step) = graph_step(&poses, edges, trusted * DOUBTED) else { return Ok(poses) };
        for (k, pose) in poses[1..].iter_mut().enumerate() {
            *pose *= Pose::new(step.fixed_rows::<3>(6 * k).into(), step.fixed_rows::<3>(6 * k + 3).into());
        }
        if trusted <= 1.0 && step.amax() < STEP_M {
            break;
        }
    }
    Ok(poses)
}

/// The step from all pairs; those found by appearance have half weight at the squared residual `doubted`.
fn graph_step(poses: &[Pose], edges: &[KeyframeEdge], doubted: f64) -> Option<DVector<f64>> {
    let size = 6 * (poses.len() - 1);
    let mut information = DMatrix::zeros(size, size);
    let mut gradient = DVector::zeros(size);
    for edge in edges {
        let (residual, by_first) = edge_residual(poses, edge);
        let own = edge_information(edge);
        let share =
            if edge.closure { (1.0 + residual.dot(&(own * residual)) / doubted).powi(-2) } else { 1.0 };
        let own = own * share;
        let [i, j] = edge.frames.map(|f| f.checked_sub(1).map(|k| 6 * k));
        // The residual is in the second camera's frame, so its derivative by that camera's motion is the
        // identity.
        for (r, c, block) in [
            (i, i, by_first.transpose() * own * by_first),
            (i, j, by_first.transpose() * own),
            (j, i, own * by_first),
            (j, j, own),
        ] {
            if let (Some(r), Some(c)) = (r, c) {
                let mut at = information.fixed_view_mut::<6, 6>(r, c);
                at += block;
            }
        }
        for (at, g) in [(i, by_first.transpose() * own * residual), (j, own * residual)] {
            if let Some(at) = at {
                let mut at = gradient.fixed_rows_mut::<6>(at);
                at += g;
            }
        }
    }
    Some(-information.cholesky()?.solve(&gradient))
}

/// Difference of the poses of a pair from its relative pose, in the second camera's frame, and its derivative
/// by a motion of the first camera in its own.
fn edge_residual(poses: &[Pose], edge: &KeyframeEdge) -> (Vector6<f64>, Matrix6<f64>) {
    let [i, j] = edge.frames;
    let second_from_first = poses[j].inverse() * poses[i];
    let off = edge.first_from_second.inverse() * second_from_first.inverse();
    (shift_and_turn(&off), -adjoint(&second_from_first))
}

/// Information of a pair, common errors included.
fn edge_information(edge: &KeyframeEdge) -> Matrix6<f64> {
    let floor = PoseNoise::EXPECTED.scaled_by(FLOOR);
    let floor = Matrix6::from_diagonal(&Vector6::from_fn(|k, _| {
        (if k < 3 { floor.translation_m } else { floor.rotation_rad }).powi(2)
    }));
    // A pair with an undetermined motion has no covariance, so a meter and a radian are added as a weak
    // prior.
    let least = Matrix6::identity();
    let covariance = (edge.information + least).cholesky().map(|c| c.inverse());
    covariance.and_then(|c| (c + floor).cholesky()).map_or(least, |c| c.inverse())
}

#[cfg(test)]
mod tests {
    use nalgebra::{SVector, Vector3};

    use super::*;

    fn edge(frames: [usize; 2], first_from_second: Pose, closure: bool) -> KeyframeEdge {
        KeyframeEdge {
            frames,
            first_from_second,
            information: Matrix6::identity() * 1e6,
            matches: Vec::new(),
            closure,
        }
    }

    /// Cameras on a circle that look outwards.
    fn circle(count: usize) -> Vec<Pose> {
        let pose = |i: usize| {
            let turn = std::f64::consts::TAU * i as f64 / count as f64;
            Pose::new(Vector3::new(turn.cos(), turn.sin(), 0.0), Vector3::z() * turn)
        };
        (0..count).map(pose).collect()
    }

    #[test]
    fn a_closed_loop_takes_drift_away() {
        let truth = circle(12);
        // As large as what pairs are taken to err by, all one way.
        let drift = Pose::new(Vector3::new(0.0012, -0.0006, 0.0009), Vector3::new(0.0006, 0.0009, -0.0012));
        let mut start = vec![truth[0]];
        let mut edges = Vec::new();
        for i in 1..truth.len() {
            let step = truth[i - 1].inverse() * truth[i] * drift;
            edges.push(edge([i - 1, i], step, false));
            start.push(start[i - 1] * step);
        }
        let far = |poses: &[Pose]| {
            let all =
                poses.iter().zip(&truth).map(|(a, b)| (a.translation.vector - b.translation.vector).norm());
            all.fold(0.0, f64::max)
        };
        let pose_graph =
            |start: &[Pose], edges: &[KeyframeEdge]| pose_graph(start, edges, &Stop::never()).unwrap();
        assert!(far(&pose_graph(&start, &edges)) > 0.01, "nothing shows the drift");
        edges.push(edge([11, 0], truth[11].inverse() * truth[0], true));
        let closed = pose_graph(&start, &edges);
        assert!(far(&closed) < 0.4 * far(&start), "{} {}", far(&closed), far(&start));
        // A wrong pair that was found by looks is overruled by two ways round.
        let wrong = Pose::new(Vector3::new(0.2, 0.1, -0.2), Vector3::new(0.1, -0.2, 0.2));
        edges.push(edge([3, 9], truth[3].inverse() * truth[9] * wrong, true));
        let overruled = pose_graph(&closed, &edges);
        assert!(far(&overruled) < 0.4 * far(&start), "{} {}", far(&overruled), far(&start));
    }

    #[test]
    fn derivatives_are_those_of_the_residual() {
        let poses = circle(5);
        let near = Pose::new(Vector3::new(1e-4, 2e-4, -1e-4), Vector3::new(2e-4, -1e-4, 1e-4));
        let pair = edge([1, 3], poses[1].inverse() * poses[3] * near, false);
        let (at, by_first) = edge_residual(&poses, &pair);
        let step = 1e-6;
        for p in 0..12 {
            let twist = SVector::<f64, 6>::from_fn(|i, _| if i == p % 6 { step } else { 0.0 });
            let mut moved = poses.clone();
            moved[if p < 6 { 1 } else { 3 }] *=
                Pose::new(twist.fixed_rows::<3>(0).into(), twist.fixed_rows::<3>(3).into());
            let slope = (edge_residual(&moved, &pair).0 - at) / step;
            let expected = if p < 6 {
                by_first.column(p).into_owned()
            } else {
                Matrix6::<f64>::identity().column(p - 6).into_owned()
            };
            // Up to the curvature of turns, at residuals of 1e-4.
            assert!((slope - expected).norm() < 1e-3, "{p}: {slope} {expected}");
        }
    }
}
