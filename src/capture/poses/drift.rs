//! Model of pose errors over time: the drift of odometry, the jitter of every pose, and a constant error
//! between the camera and the body whose poses are reported.
//!
//! Drift is a random walk of motions in the camera's frame: each pose carries on the drift of the previous
//! one plus a step. Jitter is independent for each pose. The constant error (of a hand-eye calibration, say)
//! is one motion in the frames of all cameras. The sizes of all maximize the marginal likelihood. See
//! docs/method.md (2.15).

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
    /// Constant error of the camera's place on the body whose poses are reported.
    pub mounting: PoseNoise,
}

impl PoseErrors {
    /// Prior sizes: jitter of a handheld camera, drift of odometry, which is as large after ten views, and
    /// the error of a calibration between camera and hand.
    pub const EXPECTED: Self = Self {
        jitter: PoseNoise::EXPECTED,
        walk: PoseNoise { translation_m: 0.001, rotation_rad: 0.0015 },
        mounting: PoseNoise::EXPECTED,
    };
    /// Prior sizes for a camera without drift, such as one on an arm.
    pub const WITHOUT_DRIFT: Self = Self { walk: PoseNoise::LEAST, ..Self::EXPECTED };
    /// Prior sizes for a camera that was tracked in its own images.
    pub const TRACKED: Self = Self { mounting: PoseNoise::LEAST, ..Self::WITHOUT_DRIFT };

    /// Error of the mean of `count` poses in a row, with drift from the first one on.
    pub(super) fn of_mean(&self, count: usize) -> PoseNoise {
        let drift = (count as f64 / 3.0).sqrt();
        let wandering = self.jitter.of_mean(count).of_difference(&self.walk.scaled_by(drift));
        wandering.of_difference(&self.mounting)
    }

    /// Whether the sizes have reached the largest ones considered.
    pub(super) fn are_at_most(&self) -> bool {
        self.jitter.reaches_expected() || self.walk.reaches_expected()
    }
}

/// Variances of `count` motions of one size: three of translation, three of rotation, and so on.
fn variances(noise: &PoseNoise, count: usize) -> impl Iterator<Item = f64> + use<> {
    let of_one = [noise.translation_m.powi(2), noise.rotation_rad.powi(2)];
    (0..6 * count).map(move |k| of_one[usize::from(k % 6 >= 3)])
}

/// Covariance of what independent errors of those variances cause by a matrix.
fn spread_by(matrix: &DMatrix<f64>, variances: impl Iterator<Item = f64>) -> DMatrix<f64> {
    // As the product of a matrix with its transpose, L Q L^T stays positive under rounding.
    let mut scaled = matrix.clone();
    scaled.column_iter_mut().zip(variances).for_each(|(mut column, square)| column *= square.sqrt());
    &scaled * scaled.transpose()
}

/// The correlation of the pose errors of one state, or of several that one camera recorded.
pub(super) struct Drift {
    /// Matrix from the steps of the walk to the drift of each pose in its camera's frame.
    from_steps: DMatrix<f64>,
    /// Matrix from the constant error to that of each pose: it is the same in every camera's frame.
    from_mounting: DMatrix<f64>,
    /// Number of poses of each state.
    counts: Vec<usize>,
}

impl Drift {
    /// For the reported poses of some states, each in order of time: every state drifts by itself.
    pub fn along_poses(states: &[&[Pose]]) -> Self {
        let counts: Vec<usize> = states.iter().map(|poses| poses.len()).collect();
        let size = 6 * counts.iter().sum::<usize>();
        let mut from_steps = DMatrix::zeros(size, size);
        let mut first = 0;
        for poses in states {
            for (i, to) in poses.iter().enumerate() {
                // L of docs/method.md 2.7: a step persists in all later poses, expressed in their cameras'
                // frames.
                for (k, from) in poses.iter().enumerate().take(i + 1) {
                    from_steps
                        .fixed_view_mut::<6, 6>(6 * (first + i), 6 * (first + k))
                        .copy_from(&adjoint(&(to.inverse() * from)));
                }
            }
            first += poses.len();
        }
        let from_mounting = DMatrix::from_fn(size, 6, |row, column| f64::from(u8::from(row % 6 == column)));
        Self { from_steps, from_mounting, counts }
    }

    /// Prior information about all corrections, from the sizes of each state's errors, and half its log
    /// determinant; `None` where it is not finite. The mounting is of state 0's size.
    pub fn information(&self, states: &[PoseErrors]) -> Option<(DMatrix<f64>, f64)> {
        let of_poses = || states.iter().zip(&self.counts);
        // The views do not show the common pose of all frames, so the first pose is held up to one step, its
        // jitter and the constant error.
        let walk = of_poses().flat_map(|(errors, count)| variances(&errors.walk, *count));
        let jitter = of_poses().flat_map(|(errors, count)| variances(&errors.jitter, *count));
        let mut covariance = spread_by(&self.from_steps, walk);
        covariance += spread_by(&self.from_mounting, variances(&states.first()?.mounting, 1));
        jitter.enumerate().for_each(|(k, square)| covariance[(k, k)] += square);
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
        PoseErrors {
            jitter: grown_size(
                &errors.jitter,
                pull.iter().zip(&marginal.diagonal()).map(|(u, m)| [u * u, *m]),
            ),
            walk: likelier_size(&errors.walk, &self.from_steps, &pull, &marginal),
            mounting: likelier_size(&errors.mounting, &self.from_mounting, &pull, &marginal),
        }
    }
}

/// The size of errors that reach the corrections by a matrix, made likelier: `pull` and `marginal` are u and
/// M of docs/method.md (2.15).
fn likelier_size(
    size: &PoseNoise,
    matrix: &DMatrix<f64>,
    pull: &DVector<f64>,
    marginal: &DMatrix<f64>,
) -> PoseNoise {
    let carried = marginal * matrix;
    // Only the diagonal of L^T M L is needed.
    let of_columns = matrix.column_iter().zip(carried.column_iter());
    grown_size(size, of_columns.map(|(by, carried)| [by.dot(pull).powi(2), by.dot(&carried)]))
}

/// A size of errors changed by their squares, estimated and expected (three translations, three rotations and
/// so on); at most the expected size.
fn grown_size(size: &PoseNoise, squares: impl Iterator<Item = [f64; 2]>) -> PoseNoise {
    let mut sums = [[0.0; 2]; 2];
    for (k, [found, expected]) in squares.enumerate() {
        let kind = &mut sums[usize::from(k % 6 >= 3)];
        kind[0] += found;
        kind[1] += expected;
    }
    let [translation, rotation] = sums.map(|[found, expected]| growth_of_deviation(found, expected));
    let grown = PoseNoise {
        translation_m: size.translation_m * translation,
        rotation_rad: size.rotation_rad * rotation,
    };
    grown.at_least().at_most(&PoseNoise::EXPECTED)
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
