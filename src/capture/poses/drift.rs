//! Model of pose errors over time: the drift of odometry, and the jitter of every pose.
//!
//! Drift is a random walk of motions in the camera's frame: each pose carries on the drift of the previous
//! one plus a step. Jitter is independent for each pose. The sizes of both maximize the marginal likelihood.
//! See docs/method.md (2.15).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix6};
use serde::{Deserialize, Serialize};

use super::{inverse::inverse_by_factor, pose_noise::PoseNoise};
use geometry::Pose;

/// Sizes of the pose errors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseErrors {
    /// Independent error of each pose.
    pub jitter: PoseNoise,
    /// Step of the drift from one pose to the next.
    pub walk: PoseNoise,
}

impl PoseErrors {
    /// Prior sizes: jitter of a handheld camera, and drift of odometry, which is as large after ten views.
    pub const EXPECTED: Self =
        Self { jitter: PoseNoise::EXPECTED, walk: PoseNoise { translation_m: 0.001, rotation_rad: 0.0015 } };
    /// Prior sizes for a camera without drift, such as one on an arm.
    pub const WITHOUT_DRIFT: Self = Self { walk: PoseNoise::LEAST, ..Self::EXPECTED };

    /// Error of the mean of `count` poses in a row, with drift from the first one on.
    pub(super) fn of_mean(&self, count: usize) -> PoseNoise {
        let drift = (count as f64 / 3.0).sqrt();
        self.jitter.of_mean(count).of_difference(&self.walk.scaled_by(drift))
    }

    /// Whether the sizes have reached the largest ones considered.
    pub(super) fn are_at_most(&self) -> bool {
        self.jitter.reaches_expected() || self.walk.reaches_expected()
    }

    /// Variances of the steps and of the jitter. The views do not show the common pose of all frames, so the
    /// first pose is held up to one step and its jitter.
    fn variances_of_steps(&self, size: usize) -> [DVector<f64>; 2] {
        [self.walk, self.jitter].map(|noise| {
            DVector::from_fn(size, |k, _| {
                if k % 6 < 3 { noise.translation_m.powi(2) } else { noise.rotation_rad.powi(2) }
            })
        })
    }
}

/// The correlation of a state's pose errors by drift.
pub(super) struct Drift {
    /// Matrix from the steps of the walk to the drift of each pose in its camera's frame.
    from_steps: DMatrix<f64>,
}

impl Drift {
    /// For reported poses in order of time.
    pub fn along_poses(reported: &[Pose]) -> Self {
        let size = 6 * reported.len();
        let mut from_steps = DMatrix::zeros(size, size);
        for (i, to) in reported.iter().enumerate() {
            // L of docs/method.md 2.7: a step persists in all later poses, expressed in their cameras'
            // frames.
            for (k, from) in reported.iter().enumerate().take(i + 1) {
                from_steps.fixed_view_mut::<6, 6>(6 * i, 6 * k).copy_from(&adjoint(&(to.inverse() * from)));
            }
        }
        Self { from_steps }
    }

    /// Prior information about all corrections, and half its log determinant; `None` where it is not finite.
    pub fn information(&self, errors: &PoseErrors) -> Option<(DMatrix<f64>, f64)> {
        let [walk, jitter] = errors.variances_of_steps(self.from_steps.nrows());
        // As the product of a matrix with its transpose, L Q L^T stays positive under rounding.
        let mut scaled = self.from_steps.clone();
        scaled.column_iter_mut().zip(walk.iter()).for_each(|(mut column, square)| column *= square.sqrt());
        let mut covariance = &scaled * scaled.transpose();
        jitter.iter().enumerate().for_each(|(k, square)| covariance[(k, k)] += square);
        let factor = covariance.cholesky()?;
        Some((inverse_by_factor(&factor), -half_log_determinant(&factor)))
    }

    /// One update of the sizes towards the maximum of the likelihood, from the corrections and their
    /// covariance; at most the expected sizes.
    pub fn likelier_sizes(
        &self,
        errors: &PoseErrors,
        information: &DMatrix<f64>,
        corrections: &DVector<f64>,
        covariance: &DMatrix<f64>,
    ) -> PoseErrors {
        // Information of the residuals about the corrections: docs/method.md (2.15).
        let marginal = information - information * covariance * information;
        let pull = information * corrections;
        let carried = &marginal * &self.from_steps;
        let mut steps = [[(0.0, 0.0); 2]; 2];
        for k in 0..corrections.len() {
            let kind = usize::from(k % 6 >= 3);
            let column = self.from_steps.column(k);
            // Only the diagonal of L^T M L is needed.
            for (noise, found, expected) in
                [(0, column.dot(&pull), column.dot(&carried.column(k))), (1, pull[k], marginal[(k, k)])]
            {
                steps[noise][kind].0 += found * found;
                steps[noise][kind].1 += expected;
            }
        }
        let [walk, jitter] = [(0, &errors.walk), (1, &errors.jitter)].map(|(noise, before)| {
            let [translation, rotation] =
                steps[noise].map(|(found, expected)| growth_of_deviation(found, expected));
            let size = PoseNoise {
                translation_m: before.translation_m * translation,
                rotation_rad: before.rotation_rad * rotation,
            };
            size.at_least().at_most(&PoseNoise::EXPECTED)
        });
        PoseErrors { jitter, walk }
    }
}

/// Factor for a standard deviation, from the estimated and the expected sum of squares (Harville 1977; MacKay
/// 1992). Where both agree, the marginal likelihood is stationary.
pub(super) fn growth_of_deviation(found: f64, expected: f64) -> f64 {
    // Both are zero in directions that no surface determines.
    if expected > 0.0 { (found / expected).sqrt() } else { 1.0 }
}

/// Half the log determinant of a matrix, from its Cholesky factor.
pub(super) fn half_log_determinant(factor: &Cholesky<f64, Dyn>) -> f64 {
    factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum()
}

/// Matrix that transforms small motions between two frames (the adjoint of a rigid motion).
pub(crate) fn adjoint(target_from_source: &Pose) -> Matrix6<f64> {
    let rotation = target_from_source.rotation.to_rotation_matrix();
    let mut carried = Matrix6::zeros();
    carried.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation.matrix());
    carried.fixed_view_mut::<3, 3>(3, 3).copy_from(rotation.matrix());
    let lever = target_from_source.translation.vector.cross_matrix() * rotation.matrix();
    carried.fixed_view_mut::<3, 3>(0, 3).copy_from(&lever);
    carried
}
