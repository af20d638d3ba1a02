//! All poses of a state by Gauss-Newton, and the size of their errors.

use nalgebra::{DMatrix, DVector, Vector3};

use super::{
    PoseNoise,
    pairs::{Comparison, PairSums},
};
use crate::geometry::{Pose, log_so3};

/// Rounds of association and Gauss-Newton with each size of the errors, at most.
const ROUNDS: [usize; 3] = [10, 3, 3];
/// Share of the displacement expected of the poses that counts as noise in the first rounds.
pub(super) const LOOSE: [f64; 5] = [1.0, 0.5, 0.3, 0.2, 0.1];
/// Rounds end when no camera moves further than this, metres (radians times one metre).
const STEP_M: f64 = 5e-5;

/// The poses that make the fitted pieces agree, and the size of the errors of those that were told.
pub(super) fn solve(comparison: &Comparison, told: &[Pose]) -> (Vec<Pose>, PoseNoise) {
    let mut poses = told.to_vec();
    let mut noise = PoseNoise::EXPECTED;
    let mut scale = comparison.scale(&poses);
    let mut loosened = LOOSE.into_iter();
    for rounds in ROUNDS {
        let mut covariance = None;
        for _ in 0..rounds {
            let loose = loosened.next();
            let sums = comparison.sums(&poses, scale, loose.unwrap_or(0.0));
            scale = sums.scale;
            let Some((step, spread)) = step(&sums.pairs, told, &poses, &noise) else { return (poses, noise) };
            for (pose, s) in poses.iter_mut().zip(step.as_slice().chunks_exact(6)) {
                *pose *= Pose::new(Vector3::new(s[0], s[1], s[2]), Vector3::new(s[3], s[4], s[5]));
            }
            covariance = Some(spread);
            if loose.is_none() && step.amax() < STEP_M {
                break;
            }
        }
        if let Some(covariance) = covariance {
            noise = expected_noise(told, &poses, &covariance);
        }
    }
    (poses, noise)
}

/// One step for all cameras, 6 values each: translation and rotation in its optical frame; and its covariance.
fn step(sums: &[PairSums], told: &[Pose], poses: &[Pose], noise: &PoseNoise) -> Option<(DVector<f64>, DMatrix<f64>)> {
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
    for (f, (told, pose)) in told.iter().zip(poses).enumerate() {
        let [moved, turned] = correction(told, pose);
        for k in 0..3 {
            for (at, value, sigma) in [(6 * f + k, moved[k], noise.translation_m), (6 * f + 3 + k, turned[k], noise.rotation_rad)] {
                information[(at, at)] += sigma.powi(-2);
                gradient[at] += value * sigma.powi(-2);
            }
        }
    }
    let covariance = information.cholesky()?.inverse();
    Some((-(&covariance * gradient), covariance))
}

/// Translation, metres, and rotation vector, radians, of a correction in the camera's frame.
pub(super) fn correction(told: &Pose, pose: &Pose) -> [Vector3<f64>; 2] {
    let change = told.inverse() * pose;
    [change.translation.vector, log_so3(&change.rotation)]
}

/// Size of the errors by the corrections and what is not known of them (expectation maximization), as expected at most.
fn expected_noise(told: &[Pose], poses: &[Pose], covariance: &DMatrix<f64>) -> PoseNoise {
    let mut squares = [0.0; 2];
    for (f, (told, pose)) in told.iter().zip(poses).enumerate() {
        for (k, part) in correction(told, pose).iter().enumerate() {
            let open: f64 = (0..3).map(|a| covariance[(6 * f + 3 * k + a, 6 * f + 3 * k + a)]).sum();
            squares[k] += part.norm_squared() + open;
        }
    }
    let [translation_m, rotation_rad] = squares.map(|s| (s / (3 * poses.len()) as f64).sqrt());
    let most = PoseNoise::EXPECTED;
    PoseNoise { translation_m: translation_m.min(most.translation_m), rotation_rad: rotation_rad.min(most.rotation_rad) }
}
