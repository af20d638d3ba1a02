//! Errors of a camera's poses along time: odometry drifts, and every pose jitters.
//!
//! The drift of a pose is that of the one before, carried along, and a step of its own (a random walk of
//! motions in the camera's frame); the jitter is each pose's own. Sizes of both follow from the corrections
//! by expectation maximization. See docs/method.md (2.14).

use nalgebra::{DMatrix, DVector, Matrix6};
use serde::{Deserialize, Serialize};

use super::pose_noise::PoseNoise;
use crate::geometry::Pose;

/// Sizes of the errors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseErrors {
    /// Of each pose on its own.
    pub jitter: PoseNoise,
    /// Of the step from one pose to the next.
    pub walk: PoseNoise,
}

impl PoseErrors {
    /// Before anything is known: jitter of a hand-held camera, and drift of odometry, which is that large
    /// after ten views.
    pub const EXPECTED: Self =
        Self { jitter: PoseNoise::EXPECTED, walk: PoseNoise { translation_m: 0.001, rotation_rad: 0.0015 } };

    /// Of the mean of so many poses in a row, whose drift begins with the first.
    pub(super) fn of_mean(&self, count: usize) -> PoseNoise {
        let drift = (count as f64 / 3.0).sqrt();
        self.jitter.of_mean(count).beside(&self.walk.times(drift))
    }

    /// Whether poses err by as much as is looked for at most.
    pub(super) fn are_at_most(&self) -> bool {
        let reach = |noise: &PoseNoise| {
            noise.translation_m >= PoseNoise::EXPECTED.translation_m
                || noise.rotation_rad >= PoseNoise::EXPECTED.rotation_rad
        };
        reach(&self.jitter) || reach(&self.walk)
    }

    /// Variances of the steps, and of the jitter. What frames see does not depend on where they are as a
    /// whole: the first pose holds them, but for a step and its jitter.
    fn squares(&self, size: usize) -> [DVector<f64>; 2] {
        [self.walk, self.jitter].map(|noise| {
            DVector::from_fn(size, |k, _| {
                if k % 6 < 3 { noise.translation_m.powi(2) } else { noise.rotation_rad.powi(2) }
            })
        })
    }
}

/// How the errors of the poses of a state hang together.
pub(super) struct Drift {
    /// Takes the steps of the walk to the drift of every pose, in its camera's frame.
    from_steps: DMatrix<f64>,
}

impl Drift {
    /// Of poses in the order of time.
    pub fn along(reported: &[Pose]) -> Self {
        let size = 6 * reported.len();
        let mut from_steps = DMatrix::zeros(size, size);
        for (i, to) in reported.iter().enumerate() {
            // L of docs/method.md 2.7: a step stays with all later poses, seen from where their cameras are.
            for (k, from) in reported.iter().enumerate().take(i + 1) {
                from_steps.fixed_view_mut::<6, 6>(6 * i, 6 * k).copy_from(&adjoint(&(to.inverse() * from)));
            }
        }
        Self { from_steps }
    }

    /// Information about all corrections; `None` where it is not finite.
    pub fn information(&self, errors: &PoseErrors) -> Option<DMatrix<f64>> {
        let [walk, jitter] = errors.squares(self.from_steps.nrows());
        // L Q L^T as a product of one matrix with its transpose stays positive under rounding.
        let mut scaled = self.from_steps.clone();
        scaled.column_iter_mut().zip(walk.iter()).for_each(|(mut column, square)| column *= square.sqrt());
        let mut covariance = &scaled * scaled.transpose();
        jitter.iter().enumerate().for_each(|(k, square)| covariance[(k, k)] += square);
        Some(covariance.cholesky()?.inverse())
    }

    /// Sizes by the corrections and their covariance (expectation maximization), jitter as expected at most.
    pub fn sizes(
        &self,
        errors: &PoseErrors,
        information: &DMatrix<f64>,
        corrections: &DVector<f64>,
        covariance: &DMatrix<f64>,
    ) -> PoseErrors {
        let second = corrections * corrections.transpose() + covariance;
        // M of docs/method.md (2.14): by how much the corrections exceed what was expected of them.
        let surprise = information * second * information - information;
        let carried = &surprise * &self.from_steps;
        let [walk, jitter] = errors.squares(corrections.len());
        let mut sums = [[0.0; 2]; 2];
        for k in 0..corrections.len() {
            // The diagonal of L^T M L alone is wanted.
            let of_step = self.from_steps.column(k).dot(&carried.column(k));
            let kind = usize::from(k % 6 >= 3);
            sums[0][kind] += walk[k] + walk[k].powi(2) * of_step;
            sums[1][kind] += jitter[k] + jitter[k].powi(2) * surprise[(k, k)];
        }
        // Of six values of a pose three are shifts and three are turns.
        let count = (corrections.len() / 2) as f64;
        let size = |[translation, rotation]: [f64; 2], before: &PoseNoise| PoseNoise {
            translation_m: further(before.translation_m, (translation / count).max(0.0).sqrt()),
            rotation_rad: further(before.rotation_rad, (rotation / count).max(0.0).sqrt()),
        };
        let (walk, jitter) =
            (size(sums[0], &errors.walk).at_least(), size(sums[1], &errors.jitter).at_least());
        PoseErrors { jitter: jitter.at_most(&PoseNoise::EXPECTED), walk: walk.at_most(&PoseNoise::EXPECTED) }
    }
}

/// Expectation maximization comes slowly to sizes that are near zero: its steps are lengthened
/// (over-relaxation).
fn further(before: f64, after: f64) -> f64 {
    const LONGER: f64 = 1.8;
    before * (after / before).powf(LONGER)
}

/// Takes a small motion in one frame to that in another (the adjoint of a rigid motion).
pub(super) fn adjoint(target_from_source: &Pose) -> Matrix6<f64> {
    let rotation = target_from_source.rotation.to_rotation_matrix();
    let mut carried = Matrix6::zeros();
    carried.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation.matrix());
    carried.fixed_view_mut::<3, 3>(3, 3).copy_from(rotation.matrix());
    let lever = target_from_source.translation.vector.cross_matrix() * rotation.matrix();
    carried.fixed_view_mut::<3, 3>(0, 3).copy_from(&lever);
    carried
}
