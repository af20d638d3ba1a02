//! Where a tracked map lies on a board, and how long it is, by many views. See docs/method.md 2.15.

use nalgebra::{Matrix6, SMatrix, SVector, Vector3, Vector6};

use super::sighting::BoardSighting;
use crate::{
    capture::poses::{drift::adjoint, pose_noise::PoseNoise},
    geometry::{Pose, shift_and_turn},
    statistics::median,
};

/// Views that must show the board.
/// derived: three poses leave nothing open and one to be doubted
const LEAST_VIEWS: usize = 4;
/// Tracked poses err by that against the rest of their map.
/// measured: eval/tracking, root mean square of most recordings
const TRACKED: PoseNoise = PoseNoise { translation_m: 0.001, rotation_rad: 0.001 };
/// Error of a depth sensor's scale, one standard deviation.
/// derived: as for the calibration of the sensor (docs/method.md 2.11)
const SCALE: f64 = 0.005;
/// Turn of color against depth about either axis of the image, one standard deviation, radians.
/// derived: as for the calibration of the sensor (docs/method.md 2.11)
const COLOR_TURN: f64 = 0.003;
/// The error of depth about a board differs from that of the whole by this share, one standard deviation.
/// derived: a warp of 0.4 % of the range, a tenth of its independent regions seen
const DEPTH_SHARE: f64 = 0.0013;
/// Rounds of Gauss-Newton at most.
const ROUNDS: usize = 20;
/// Rounds end when nothing moves further than this, meters (radians times one meter).
/// derived: a thousandth of what the frame is to be known to
const STEP_M: f64 = 1e-6;
/// Squared length of six residuals in standard deviations at which a view counts a quarter (Geman and McClure
/// 1985).
/// derived: 0.3 % of a chi-square distribution of six degrees
const DOUBTED: f64 = 20.0;
/// A view whose squared length is more than so many times that does not agree.
const DISAGREES: f64 = 2.0;

/// Motion of the map, its relative length, turn of the color camera about x and y.
type Step = SVector<f64, 9>;
/// Where the length and the turn stand among the unknowns.
const LENGTH: usize = 6;
const TURN: usize = 7;

/// Where a map lies on a board.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardPlace {
    /// From the map at the length of the board to the board.
    pub board_from_map: Pose,
    /// Lengths on the board over those of the map, and the standard deviation of that.
    pub scale: [f64; 2],
    /// Turn of the color camera against the tracked one about x and y, radians.
    pub color_turn: [f64; 2],
    /// Views that show the board.
    pub views: usize,
    /// Of those, views that agree.
    pub agreeing: usize,
    /// Median distance of the edges of tags from where they should be, pixels.
    pub edges_px: f64,
    /// Covariance of the map's motion in the map's frame about the board's middle: shift, meters, and turn.
    pub covariance: Matrix6<f64>,
}

/// A view that shows the board: the camera's pose in the map, and what it sees.
pub struct BoardInView<'a> {
    /// Of the tracked camera.
    pub map_from_camera: Pose,
    /// What it sees.
    pub sighting: &'a BoardSighting,
}

/// A pose with its place that many times as far from the origin.
#[must_use]
pub fn stretched(pose: &Pose, scale: f64) -> Pose {
    Pose::from_parts((pose.translation.vector * scale).into(), pose.rotation)
}

impl BoardPlace {
    /// The place by all views that show a board; `scale` is given where it is known. `None` where too few
    /// views agree.
    #[must_use]
    pub fn of(views: &[BoardInView<'_>], scale: Option<f64>) -> Option<Self> {
        if views.len() < LEAST_VIEWS {
            return None;
        }
        let problem = Problem { views, known: scale, by_depth: depth_scale(views) };
        // Some views may be wrong: the best of several starts.
        let start = |v: &BoardInView<'_>| {
            let at = stretched(&v.map_from_camera, problem.start_scale());
            v.sighting.board_from_camera * at.inverse()
        };
        let step = (views.len() / STARTS).max(1);
        let starts = views.iter().step_by(step).map(|v| problem.fit(start(v)));
        let best = starts.flatten().min_by(|a, b| a.cost.total_cmp(&b.cost))?;
        problem.place(&best)
    }

    /// Pose on the board of a camera whose pose in the map is given.
    #[must_use]
    pub fn on_board(&self, map_from_camera: &Pose) -> Pose {
        self.board_from_map * stretched(map_from_camera, self.scale[0])
    }

    /// Standard deviation of where a point lies that is so far from the board's middle, meters: at the middle
    /// and in the worst direction.
    #[must_use]
    pub fn sigma_m(&self, away_m: f64) -> f64 {
        let block = |k: usize| self.covariance.fixed_view::<3, 3>(k, k).symmetric_eigenvalues().max();
        block(0).max(0.0).sqrt().hypot(away_m * block(3).max(0.0).sqrt())
    }
}

/// Starts that are tried.
const STARTS: usize = 12;

/// Lengths on the board over those that depth reads there, and their deviation.
fn depth_scale(views: &[BoardInView<'_>]) -> Option<[f64; 2]> {
    let ratios: Vec<f64> = views.iter().filter_map(|v| v.sighting.depth_ratio).collect();
    let count = ratios.len();
    let middle = median(ratios.clone())?;
    let off = median(ratios.iter().map(|r| (r - middle).abs()).collect())?;
    (count >= LEAST_VIEWS).then(|| [1.0 / middle, (1.4826 * off / (count as f64).sqrt()).hypot(DEPTH_SHARE)])
}

struct Problem<'a> {
    views: &'a [BoardInView<'a>],
    /// Where it is not to be found.
    known: Option<f64>,
    by_depth: Option<[f64; 2]>,
}

struct Fit {
    board_from_map: Pose,
    scale: f64,
    turn: [f64; 2],
    information: SMatrix<f64, 9, 9>,
    /// Of residuals in expected ones, at least 1.
    deviation: f64,
    cost: f64,
    agreeing: usize,
}

impl Problem<'_> {
    fn start_scale(&self) -> f64 {
        self.known.or(self.by_depth.map(|d| d[0])).unwrap_or(1.0)
    }

    fn fit(&self, board_from_map: Pose) -> Option<Fit> {
        let mut fit = Fit {
            board_from_map,
            scale: self.start_scale(),
            turn: [0.0; 2],
            information: SMatrix::zeros(),
            deviation: 1.0,
            cost: 0.0,
            agreeing: 0,
        };
        for _ in 0..ROUNDS {
            let gradient = self.sums(&mut fit)?;
            let step: Step = -fit.information.cholesky()?.solve(&gradient);
            fit.board_from_map *= Pose::new(step.fixed_rows::<3>(0).into(), step.fixed_rows::<3>(3).into());
            fit.scale *= step[LENGTH].exp();
            fit.turn = [fit.turn[0] + step[TURN], fit.turn[1] + step[TURN + 1]];
            if step.amax() < STEP_M {
                break;
            }
        }
        self.sums(&mut fit)?;
        Some(fit)
    }

    /// Normal equations about a fit; fills in its information, deviation and cost.
    fn sums(&self, fit: &mut Fit) -> Option<Step> {
        let (mut information, mut gradient) = (SMatrix::<f64, 9, 9>::zeros(), Step::zeros());
        let all: Vec<_> = self.views.iter().filter_map(|v| residual(fit, v)).collect();
        let squares: Vec<f64> = all.iter().map(|(r, _, w)| r.dot(&(w * r))).collect();
        // The median of a chi-square distribution of six degrees is 5.35.
        let variance = (median(squares.clone())? / 5.35).max(1.0);
        fit.deviation = variance.sqrt();
        (fit.cost, fit.agreeing) = (0.0, 0);
        for ((r, slopes, w), square) in all.iter().zip(squares) {
            let doubt = square / (DOUBTED * variance);
            let w = w * (1.0 + doubt).powi(-2);
            information += slopes.transpose() * w * slopes;
            gradient += slopes.transpose() * (w * r);
            // Not by the fit's own deviation, so that fits can be compared.
            fit.cost += square / (DOUBTED + square);
            fit.agreeing += usize::from(doubt <= DISAGREES);
        }
        let mut known = |k: usize, off: f64, sigma: f64| {
            let own = variance * sigma.powi(-2);
            information[(k, k)] += own;
            gradient[k] += own * off;
        };
        for k in 0..2 {
            known(TURN + k, fit.turn[k], COLOR_TURN);
        }
        match (self.known, self.by_depth) {
            (Some(scale), _) => known(LENGTH, (fit.scale / scale).ln(), 1e-9),
            (None, Some([scale, sigma])) => known(LENGTH, (fit.scale / scale).ln(), sigma),
            (None, None) => known(LENGTH, fit.scale.ln(), SCALE),
        }
        fit.information = information;
        Some(gradient)
    }

    fn place(&self, fit: &Fit) -> Option<BoardPlace> {
        if fit.agreeing < LEAST_VIEWS {
            return None;
        }
        let covariance = fit.information.cholesky()?.inverse() * fit.deviation.powi(2);
        // In the map's frame about its origin: about the board's middle it is another.
        let map_from_board = fit.board_from_map.inverse();
        let middle = Pose::from_parts(map_from_board.translation, nalgebra::UnitQuaternion::identity());
        let about_middle = adjoint(&middle.inverse());
        let own = covariance.fixed_view::<6, 6>(0, 0).into_owned();
        Some(BoardPlace {
            board_from_map: fit.board_from_map,
            scale: [fit.scale, fit.scale * covariance[(LENGTH, LENGTH)].max(0.0).sqrt()],
            color_turn: fit.turn,
            views: self.views.len(),
            agreeing: fit.agreeing,
            edges_px: median(self.views.iter().map(|v| v.sighting.rms_px).collect())?,
            covariance: about_middle * own * about_middle.transpose(),
        })
    }
}

/// Where the board puts a color camera against where the map does, in the camera's frame; the derivatives by
/// the unknowns; the information.
fn residual(fit: &Fit, view: &BoardInView<'_>) -> Option<(Vector6<f64>, SMatrix<f64, 6, 9>, Matrix6<f64>)> {
    let turn = Vector3::new(fit.turn[0], fit.turn[1], 0.0);
    let in_map = stretched(&view.map_from_camera, fit.scale);
    let map_from_color = in_map * Pose::new(Vector3::zeros(), turn);
    let expected = fit.board_from_map * map_from_color;
    let off = shift_and_turn(&(expected.inverse() * view.sighting.board_from_camera));
    let mut slopes = SMatrix::<f64, 6, 9>::zeros();
    let by_map = -adjoint(&map_from_color.inverse());
    slopes.fixed_view_mut::<6, 6>(0, 0).copy_from(&by_map);
    let stretch = map_from_color.inverse_transform_vector(&in_map.translation.vector);
    slopes.fixed_view_mut::<3, 1>(0, LENGTH).copy_from(&-stretch);
    (slopes[(3, TURN)], slopes[(4, TURN + 1)]) = (-1.0, -1.0);
    let tracked = Matrix6::from_diagonal(&Vector6::from_fn(|k, _| {
        (if k < 3 { TRACKED.translation_m } else { TRACKED.rotation_rad }).powi(2)
    }));
    let information = (view.sighting.covariance + tracked).cholesky()?.inverse();
    Some((off, slopes, information))
}

#[cfg(test)]
#[path = "place_tests.rs"]
mod tests;
