//! The pose of a map on a board, by many views. See docs/method.md 2.15.

use nalgebra::{Matrix6, Matrix6x3, SMatrix, UnitQuaternion, Vector3, Vector6};

use super::{pose::STEP_M, sighting::BoardSighting};
use crate::poses::{drift::adjoint, pose_noise::PoseNoise};
use common::stop::{Stop, Stopped};
use geometry::{Intrinsics, Pose, shift_and_turn};
use numeric::statistics::{CHI_SQUARE_MEDIAN_6, SIGMAS_PER_MAD, median};

/// Fewest views of the board.
/// derived: three poses determine the fit; a fourth can contradict it
const LEAST_VIEWS: usize = 4;
/// Independent error of a pose in the map; the jackknife over blocks finds the common errors.
/// measured: eval/tracking, root mean square of most recordings
const TRACKED: PoseNoise = PoseNoise { translation_m: 0.001, rotation_rad: 0.001 };
/// Relative standard deviation of the depth error at the board against that of the whole image.
/// derived: a warp of 0.4 % of the range, of which the board covers a tenth of the independent regions
const DEPTH_SHARE: f64 = 0.0013;
/// Scale of a board without depth readings, and its standard deviation.
/// derived: the expected scale of a depth sensor (docs/method.md 2.11)
pub const UNREAD_BOARD: [f64; 2] = [1.0, 0.005];
/// Most rounds of Gauss-Newton.
const ROUNDS: usize = 20;
/// Squared norm of a view's six normalized residuals at which its weight is a quarter (Geman and McClure
/// 1985).
/// derived: 0.3 % of a chi-square distribution of six degrees
const DOUBTED: f64 = 20.0;
/// A view disagrees where its squared norm exceeds this multiple of it.
/// chosen: well beyond the norm with a quarter of the weight
const DISAGREES: f64 = 2.0;
/// Number of views tried as a start, since some may be wrong.
const STARTS: usize = 12;
/// Number of blocks of views for the jackknife.
/// derived: more than the six unknowns, and each longer than drift is correlated
const BLOCKS: usize = 8;

/// Rotation of the color camera against the depth camera about x and y, radians, as known beforehand: a board
/// cannot show it, since a slightly bent map looks the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorTurn {
    /// Expected rotation.
    pub mean_rad: [f64; 2],
    /// Standard deviations.
    pub sigma_rad: [f64; 2],
}

impl ColorTurn {
    /// Of a sensor that was not calibrated.
    /// derived: as for the calibration of the sensor (docs/method.md 2.11)
    pub const EXPECTED: Self = Self { mean_rad: [0.0; 2], sigma_rad: [0.003; 2] };

    /// From the color shift of a calibrated sensor, pixels, and its standard deviations.
    #[must_use]
    pub fn of_shift([[u, v], [sigma_u, sigma_v]]: [[f64; 2]; 2], k: &Intrinsics) -> Self {
        Self { mean_rad: [v / k.fy, -u / k.fx], sigma_rad: [sigma_v / k.fy, sigma_u / k.fx] }
    }
}

/// The pose of a map on a board.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardPlace {
    /// From the map, scaled to the length of the board, to the board.
    pub board_from_map: Pose,
    /// Number of views of the board.
    pub views: usize,
    /// Number of agreeing views.
    pub agreeing: usize,
    /// Median residual of the tags' edges, pixels.
    pub edges_px: f64,
    /// Covariance of a motion of the map about the board's center, in the map's frame: translation, meters,
    /// and rotation, radians.
    pub covariance: Matrix6<f64>,
}

/// A view of the board: the pose of its camera in the map, and the sighting.
#[derive(Clone, Copy)]
pub struct BoardInView<'a> {
    /// Pose of the depth camera in the map.
    pub map_from_camera: Pose,
    /// The board as this view shows it.
    pub sighting: &'a BoardSighting,
}

/// A pose with its translation multiplied by `scale`.
#[must_use]
pub fn pose_scaled(pose: &Pose, scale: f64) -> Pose {
    Pose::from_parts((pose.translation.vector * scale).into(), pose.rotation)
}

/// Scale of the board over depth, and its standard deviation, by the depth ratios of the views; `None` for
/// too few.
#[must_use]
pub fn board_scale(ratios: &[f64]) -> Option<[f64; 2]> {
    let middle = median(ratios.to_vec())?;
    let off = median(ratios.iter().map(|r| (r - middle).abs()).collect())?;
    let of_mean = SIGMAS_PER_MAD * off / (ratios.len() as f64).sqrt();
    (ratios.len() >= LEAST_VIEWS).then(|| [1.0 / middle, of_mean.hypot(DEPTH_SHARE)])
}

impl BoardPlace {
    /// Distance from the board for which messages give the uncertainty, meters.
    /// chosen: about the distance of an object from its board
    pub const AWAY_M: f64 = 0.5;

    /// The pose of the map by all views of a board, in order of time. `scale` is the length of the board over
    /// that of the map, with its standard deviation. `None` where too few views agree.
    ///
    /// # Errors
    /// [`Stopped`].
    pub fn from_views(
        views: &[BoardInView<'_>],
        scale: [f64; 2],
        color: &ColorTurn,
        stop: &Stop,
    ) -> Result<Option<Self>, Stopped> {
        if views.len() < LEAST_VIEWS {
            return Ok(None);
        }
        let problem = PlaceProblem { views, scale: scale[0], turn: color.mean_rad };
        let step = (views.len() / STARTS).max(1);
        let mut fits = Vec::new();
        for view in views.iter().step_by(step) {
            stop.check()?;
            fits.extend(problem.fitted_from(problem.by_one(view)));
        }
        let best = fits.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
        Ok(best
            .filter(|best| best.agreeing >= LEAST_VIEWS)
            .and_then(|best| problem.place(&best, scale, color)))
    }

    /// Standard deviation of a point `away_m` from the board's center, meters, in the worst direction.
    #[must_use]
    pub fn sigma_m(&self, away_m: f64) -> f64 {
        let [shift_m, turn_rad] = [0, 3]
            .map(|k| self.covariance.fixed_view::<3, 3>(k, k).symmetric_eigenvalues().max().max(0.0).sqrt());
        shift_m.hypot(away_m * turn_rad)
    }
}

struct PlaceProblem<'a> {
    views: &'a [BoardInView<'a>],
    scale: f64,
    turn: [f64; 2],
}

struct PlaceFit {
    board_from_map: Pose,
    information: Matrix6<f64>,
    /// Derivative of the gradient by the log scale and the rotation of color.
    by_known: Matrix6x3<f64>,
    cost: f64,
    agreeing: usize,
}

/// Residual of a view: the board's pose of the color camera against the map's, in the camera's frame; its
/// derivatives by a motion of the map, and by the log scale and the rotation; its information.
struct ViewResidual {
    off: Vector6<f64>,
    by_map: Matrix6<f64>,
    by_known: Matrix6x3<f64>,
    information: Matrix6<f64>,
}

impl PlaceProblem<'_> {
    fn color_in_map(&self, view: &BoardInView<'_>) -> Pose {
        let turn = Vector3::new(self.turn[0], self.turn[1], 0.0);
        pose_scaled(&view.map_from_camera, self.scale) * Pose::new(Vector3::zeros(), turn)
    }

    fn by_one(&self, view: &BoardInView<'_>) -> Pose {
        view.sighting.board_from_camera * self.color_in_map(view).inverse()
    }

    fn fitted_from(&self, board_from_map: Pose) -> Option<PlaceFit> {
        let mut at = board_from_map;
        for _ in 0..ROUNDS {
            let (fit, gradient) = self.normal_equations(&at)?;
            let step: Vector6<f64> = -fit.information.cholesky()?.solve(&gradient);
            at *= Pose::new(step.fixed_rows::<3>(0).into(), step.fixed_rows::<3>(3).into());
            if step.amax() < STEP_M {
                break;
            }
        }
        Some(self.normal_equations(&at)?.0)
    }

    /// The pose of the best fit with its covariance; `None` where the fit leaves a motion undetermined.
    fn place(&self, best: &PlaceFit, scale: [f64; 2], color: &ColorTurn) -> Option<BoardPlace> {
        // Not estimated here: the scale, and the rotation of color.
        let open = -(best.information.cholesky()?.solve(&best.by_known));
        let known = Vector3::new(scale[1] / scale[0], color.sigma_rad[0], color.sigma_rad[1]);
        let own =
            self.by_blocks(best) + open * SMatrix::from_diagonal(&known.map(|s| s * s)) * open.transpose();
        // From the origin of the map's frame to the board's center.
        let middle = Pose::from_parts(best.board_from_map.inverse().translation, UnitQuaternion::identity());
        let about_middle = adjoint(&middle.inverse());
        Some(BoardPlace {
            board_from_map: best.board_from_map,
            views: self.views.len(),
            agreeing: best.agreeing,
            edges_px: median(self.views.iter().map(|v| v.sighting.rms_px).collect())?,
            covariance: about_middle * own * about_middle.transpose(),
        })
    }

    /// Normal equations at a pose: the gradient by a motion of the map, and the rest of the fit.
    fn normal_equations(&self, board_from_map: &Pose) -> Option<(PlaceFit, Vector6<f64>)> {
        let all: Vec<ViewResidual> =
            self.views.iter().map(|v| self.residual_of_view(board_from_map, v)).collect::<Option<_>>()?;
        let squares: Vec<f64> = all.iter().map(|r| r.off.dot(&(r.information * r.off))).collect();
        let variance = (median(squares.clone())? / CHI_SQUARE_MEDIAN_6).max(1.0);
        let mut gradient = Vector6::zeros();
        let mut fit = PlaceFit {
            board_from_map: *board_from_map,
            information: Matrix6::zeros(),
            by_known: Matrix6x3::zeros(),
            cost: 0.0,
            agreeing: 0,
        };
        for (r, square) in all.iter().zip(squares) {
            let doubt = square / (DOUBTED * variance);
            let weighted = r.by_map.transpose() * r.information * (1.0 + doubt).powi(-2);
            fit.information += weighted * r.by_map;
            fit.by_known += weighted * r.by_known;
            gradient += weighted * r.off;
            // Without the estimated deviation, so that fits can be compared.
            fit.cost += square / (DOUBTED + square);
            fit.agreeing += usize::from(doubt <= DISAGREES);
        }
        Some((fit, gradient))
    }

    /// The term of a view in the sum of docs/method.md (2.29).
    fn residual_of_view(&self, board_from_map: &Pose, view: &BoardInView<'_>) -> Option<ViewResidual> {
        let map_from_color = self.color_in_map(view);
        let off =
            shift_and_turn(&((board_from_map * map_from_color).inverse() * view.sighting.board_from_camera));
        let stretch = map_from_color.inverse_transform_vector(&map_from_color.translation.vector);
        let mut by_known = Matrix6x3::zeros();
        by_known.fixed_view_mut::<3, 1>(0, 0).copy_from(&-stretch);
        (by_known[(3, 1)], by_known[(4, 2)]) = (-1.0, -1.0);
        let tracked = Vector6::from_fn(|k, _| {
            (if k < 3 { TRACKED.translation_m } else { TRACKED.rotation_rad }).powi(2)
        });
        let covariance = view.sighting.covariance + Matrix6::from_diagonal(&tracked);
        let information = covariance.cholesky()?.inverse();
        Some(ViewResidual { off, by_map: -adjoint(&map_from_color.inverse()), by_known, information })
    }

    /// Covariance of the pose by its changes as blocks of views are left out in turn, since errors of
    /// neighboring views are correlated (block jackknife: Kuensch 1989).
    fn by_blocks(&self, best: &PlaceFit) -> Matrix6<f64> {
        let blocks = BLOCKS.min(self.views.len());
        let moved: Vec<Vector6<f64>> =
            (0..blocks).filter_map(|block| self.change_without_block(best, block, blocks)).collect();
        let count = moved.len().max(1) as f64;
        let mean = moved.iter().sum::<Vector6<f64>>() / count;
        let sum: Matrix6<f64> = moved.iter().map(|m| (m - mean) * (m - mean).transpose()).sum();
        sum * ((count - 1.0) / count)
    }

    /// Translation, meters, and rotation, radians, of the pose fitted without one block of views; `None`
    /// where the fit fails.
    fn change_without_block(&self, best: &PlaceFit, block: usize, blocks: usize) -> Option<Vector6<f64>> {
        let views: Vec<BoardInView<'_>> = (0..self.views.len())
            .filter(|k| k * blocks / self.views.len() != block)
            .map(|k| self.views[k])
            .collect();
        let fit = PlaceProblem { views: &views, ..*self }.fitted_from(best.board_from_map)?;
        Some(shift_and_turn(&(best.board_from_map.inverse() * fit.board_from_map)))
    }
}

#[cfg(test)]
#[path = "place_tests.rs"]
mod tests;
