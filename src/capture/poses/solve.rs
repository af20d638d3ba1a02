//! All poses of a state by Gauss-Newton, and the size of their errors.

use nalgebra::{DMatrix, DVector, Vector3};

use super::{
    pairs::{Comparison, PairSums},
    pose_noise::PoseNoise,
};
use crate::geometry::{Pose, log_so3};

/// Rounds of association and Gauss-Newton with each size of the errors, at most.
const ROUNDS: [usize; 3] = [10, 3, 3];
/// Share of the displacement expected of the poses that counts as noise in the first rounds.
pub(super) const LOOSE: [f64; 5] = [1.0, 0.5, 0.3, 0.2, 0.1];
/// Rounds end when no camera moves further than this, meters (radians times one meter).
const STEP_M: f64 = 5e-5;

/// The poses that make the fitted surfels agree, and the size of the errors of the reported ones.
pub(super) fn solve(comparison: &Comparison, reported: &[Pose]) -> (Vec<Pose>, PoseNoise) {
    let mut poses = reported.to_vec();
    let mut noise = PoseNoise::EXPECTED;
    let mut scale = comparison.scale(&poses);
    let mut loosened = LOOSE.into_iter();
    for rounds in ROUNDS {
        let mut covariance = None;
        for _ in 0..rounds {
            let loose = loosened.next();
            let sums = comparison.sums(&poses, scale, loose.unwrap_or(0.0));
            scale = sums.scale;
            let Some((step, spread)) = step(&sums.pairs, reported, &poses, &noise) else {
                return (poses, noise);
            };
            for (pose, s) in poses.iter_mut().zip(step.as_slice().chunks_exact(6)) {
                *pose *= Pose::new(Vector3::new(s[0], s[1], s[2]), Vector3::new(s[3], s[4], s[5]));
            }
            covariance = Some(spread);
            if loose.is_none() && step.amax() < STEP_M {
                break;
            }
        }
        if let Some(covariance) = covariance {
            noise = expected_noise(reported, &poses, &covariance);
        }
    }
    (poses, noise)
}

/// One step for all cameras, 6 values each: translation and rotation in its optical frame; and its
/// covariance.
fn step(
    sums: &[PairSums],
    reported: &[Pose],
    poses: &[Pose],
    noise: &PoseNoise,
) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let unknowns = 6 * poses.len();
    let (mut information, mut gradient) = (DMatrix::zeros(unknowns, unknowns), DVector::zeros(unknowns));
    for sums in sums {
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
    for (f, (reported, pose)) in reported.iter().zip(poses).enumerate() {
        let [moved, turned] = correction(reported, pose);
        for k in 0..3 {
            for (at, value, sigma) in
                [(6 * f + k, moved[k], noise.translation_m), (6 * f + 3 + k, turned[k], noise.rotation_rad)]
            {
                information[(at, at)] += sigma.powi(-2);
                gradient[at] += value * sigma.powi(-2);
            }
        }
    }
    let covariance = information.cholesky()?.inverse();
    Some((-(&covariance * gradient), covariance))
}

/// Translation, meters, and rotation vector, radians, of a correction in the camera's frame.
pub(super) fn correction(reported: &Pose, pose: &Pose) -> [Vector3<f64>; 2] {
    let change = reported.inverse() * pose;
    [change.translation.vector, log_so3(&change.rotation)]
}

/// Size of the errors by the corrections and what is not known of them (expectation maximization), as
/// expected at most. See docs/method.md (2.14).
fn expected_noise(reported: &[Pose], poses: &[Pose], covariance: &DMatrix<f64>) -> PoseNoise {
    let mut squares = [0.0; 2];
    for (f, (reported, pose)) in reported.iter().zip(poses).enumerate() {
        for (k, part) in correction(reported, pose).iter().enumerate() {
            let open: f64 = (0..3).map(|a| covariance[(6 * f + 3 * k + a, 6 * f + 3 * k + a)]).sum();
            squares[k] += part.norm_squared() + open;
        }
    }
    let [translation_m, rotation_rad] = squares.map(|s| (s / (3 * poses.len()) as f64).sqrt());
    let most = PoseNoise::EXPECTED;
    PoseNoise {
        translation_m: translation_m.min(most.translation_m),
        rotation_rad: rotation_rad.min(most.rotation_rad),
    }
}
