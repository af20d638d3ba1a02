//! The camera pose in a view of a board, by the edges of its tags. See docs/method.md 2.15.

use nalgebra::{Matrix2x3, Matrix6, Point2, Point3, SMatrix, SVector, Vector2, Vector3};

use super::{
    detection::SeenTag,
    edges::EdgePoint,
    layout::BoardLayout,
    start::{pose_by_homography, turned_over},
};
use geometry::{Intrinsics, Pose};
use numeric::statistics::{SIGMAS_PER_MAD, median};

/// Standard deviation of the spread of ink and of bright areas, pixels: it shifts the edges of all tags
/// outward or inward alike.
/// chosen: half a pixel of blur, read in nonlinear brightness
const INK_PX: f64 = 0.3;
/// Most rounds of Gauss-Newton.
const ROUNDS: usize = 20;
/// Rounds end with a motion smaller than this, meters (radians times one meter).
/// chosen: a thousandth of the required accuracy of the frame
pub(super) const STEP_M: f64 = 1e-6;
/// Normalized residual at which its weight is a quarter (Geman and McClure 1985).
/// chosen: 0.3 % of a normal distribution
const DOUBTED: f64 = 3.0;
/// Largest residual of a tag's edges, pixels: beyond, the tag is bent, or another one of the same number.
/// chosen: beyond any blur and any error of a usual lens model
const OTHER_PX: f64 = 1.5;
/// Largest residual of an edge at the start, pixels; the first rounds reduce the weight of larger ones.
/// chosen: detected corners are much more accurate
const START_PX: f64 = 5.0;

/// Fit of a camera pose to a board.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct BoardPose {
    pub board_from_camera: Pose,
    /// Information about the camera's motion in its own frame, meters and radians.
    pub covariance: Matrix6<f64>,
    /// Outward offset of the edges from their printed position, pixels.
    pub ink_px: f64,
    /// Root mean square residual of the edges of agreeing tags, pixels.
    pub rms_px: f64,
    /// Numbers of the agreeing tags.
    pub tags: Vec<u16>,
}

/// Edges of tags in a view.
pub(super) struct BoardView<'a> {
    pub intrinsics: &'a Intrinsics,
    pub layout: &'a BoardLayout,
    pub points: &'a [EdgePoint],
}

/// Unknowns: motion of the camera in its own frame, and spread of the ink.
type Step = SVector<f64, 7>;

struct ViewFit {
    board_from_camera: Pose,
    ink_px: f64,
    information: SMatrix<f64, 7, 7>,
    /// Robust standard deviation of the normalized residuals, at least 1.
    scale: f64,
    /// Sum of the robust costs.
    cost: f64,
}

impl BoardView<'_> {
    /// The pose with the most agreeing edges; `tags` give the starts.
    pub fn pose_of_board(&self, tags: &[SeenTag]) -> Option<BoardPose> {
        // Starts from all tags, and from each alone in case the others are wrong.
        let all: Vec<_> = tags.iter().flat_map(|tag| self.corner_pairs(tag)).collect();
        let starts = std::iter::once(all).chain(tags.iter().map(|tag| self.corner_pairs(tag)));
        let fits = starts.filter_map(|p| self.fit_from(&pose_by_homography(self.intrinsics, &p)?.inverse()));
        let mut best = fits.min_by(|a, b| a.cost.total_cmp(&b.cost))?;
        let over = turned_over(&best.board_from_camera.inverse()).and_then(|p| self.fit_from(&p.inverse()));
        if let Some(over) = over.filter(|o| o.cost < best.cost) {
            best = over;
        }
        self.pose_of_fit(&best)
    }

    /// Corners of a tag on the board, meters, each with its pixel.
    fn corner_pairs(&self, seen: &SeenTag) -> Vec<(Point2<f64>, Point2<f64>)> {
        self.layout.tag_corners(seen.tag).into_iter().flatten().zip(seen.corners).collect()
    }

    /// Residual of an edge point under a fit, pixels; infinite where it projects nowhere.
    fn distance_px(&self, fit: &ViewFit, point: &EdgePoint) -> f64 {
        let camera_from_board = fit.board_from_camera.inverse();
        self.edge_residual(&camera_from_board, fit.ink_px, point).map_or(f64::INFINITY, |(r, _)| r.abs())
    }

    fn pose_of_fit(&self, fit: &ViewFit) -> Option<BoardPose> {
        let mut tags: Vec<u16> = self.points.iter().map(|p| p.tag).collect();
        tags.dedup();
        tags.retain(|tag| {
            let mut points = self.points.iter().filter(|p| p.tag == *tag);
            points.all(|p| self.distance_px(fit, p) < OTHER_PX)
        });
        let of_tags = self.points.iter().filter(|p| tags.contains(&p.tag));
        let squares: Vec<f64> = of_tags.map(|p| self.distance_px(fit, p).powi(2)).collect();
        let covariance = fit.information.cholesky()?.inverse() * fit.scale.powi(2);
        Some(BoardPose {
            board_from_camera: fit.board_from_camera,
            covariance: covariance.fixed_view::<6, 6>(0, 0).into_owned(),
            ink_px: fit.ink_px,
            rms_px: (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt(),
            tags,
        })
    }

    /// Gauss-Newton from a pose.
    fn fit_from(&self, start: &Pose) -> Option<ViewFit> {
        let mut fit = ViewFit {
            board_from_camera: *start,
            ink_px: 0.0,
            information: SMatrix::zeros(),
            scale: 1.0,
            cost: 0.0,
        };
        for round in 0..ROUNDS {
            let loose_px = START_PX * 0.3f64.powi(round as i32);
            let gradient = self.normal_equations(&mut fit, loose_px)?;
            let step: Step = -fit.information.cholesky()?.solve(&gradient);
            fit.board_from_camera *=
                Pose::new(step.fixed_rows::<3>(0).into(), step.fixed_rows::<3>(3).into());
            fit.ink_px += step[6];
            if !step.iter().all(|s| s.is_finite()) {
                return None;
            }
            if loose_px < INK_PX && step.fixed_rows::<6>(0).amax() < STEP_M {
                break;
            }
        }
        self.normal_equations(&mut fit, 0.0)?;
        Some(fit)
    }

    /// Normal equations at a fit; sets its information, scale and cost.
    fn normal_equations(&self, fit: &mut ViewFit, loose_px: f64) -> Option<Step> {
        let camera_from_board = fit.board_from_camera.inverse();
        let residuals: Vec<Option<(f64, Step)>> =
            self.points.iter().map(|p| self.edge_residual(&camera_from_board, fit.ink_px, p)).collect();
        let lengths = self.points.iter().zip(&residuals);
        let lengths: Vec<f64> = lengths.filter_map(|(p, r)| Some(r.as_ref()?.0.abs() / p.sigma_px)).collect();
        fit.scale = (SIGMAS_PER_MAD * median(lengths)?).max(1.0);
        let (mut information, mut gradient) = (SMatrix::<f64, 7, 7>::zeros(), Step::zeros());
        information[(6, 6)] = INK_PX.powi(-2) * fit.scale.powi(2);
        gradient[6] = information[(6, 6)] * fit.ink_px;
        fit.cost = 0.0;
        for (point, residual) in self.points.iter().zip(&residuals) {
            let Some((r, slope)) = residual else {
                // Behind the camera: the worst residual.
                fit.cost += DOUBTED.powi(2);
                continue;
            };
            let sigma = (fit.scale * point.sigma_px).hypot(loose_px);
            let doubt = (r / (DOUBTED * sigma)).powi(2);
            let weight = (1.0 + doubt).powi(-2) * point.sigma_px.powi(-2);
            information += slope * slope.transpose() * weight;
            gradient += slope * (*r * weight);
            // In fixed pixels, so that fits can be compared.
            let bounded = (r / OTHER_PX).powi(2);
            fit.cost += DOUBTED.powi(2) * bounded / (1.0 + bounded);
        }
        fit.information = information;
        Some(gradient)
    }

    /// Distance of a measured point outside the predicted edge, pixels, and its derivatives by the unknowns.
    /// See docs/method.md (2.28).
    fn edge_residual(&self, camera_from_board: &Pose, ink_px: f64, point: &EdgePoint) -> Option<(f64, Step)> {
        let corners = self.layout.tag_corners(point.tag)?;
        let ends = [corners[point.edge], corners[(point.edge + 1) % 4]];
        let [from, to] = ends.map(|p| camera_from_board * Point3::new(p.x, p.y, 0.0));
        let [a, b] = [from, to].map(|p| self.intrinsics.project(&p));
        let a = Point2::from(<[f64; 2]>::from(a?));
        let b = Point2::from(<[f64; 2]>::from(b?));
        let along = (b - a).try_normalize(1e-9)?;
        let outward = Vector2::new(along.y, -along.x);
        let residual = outward.dot(&(point.at - a)) - ink_px;
        // The point of the predicted edge next to the measured one; a motion along the edge changes nothing.
        let k = self.intrinsics;
        let center = Vector2::new(k.cx, k.cy);
        let level = Vector3::new(k.fx * along.x, k.fy * along.y, along.dot(&(center - point.at.coords)));
        let share = -level.dot(&from.coords) / level.dot(&(to - from));
        let seen = from + (to - from) * share;
        let z = seen.z;
        if !(z > 1e-9) {
            return None;
        }
        let by_point =
            Matrix2x3::new(k.fx / z, 0.0, -k.fx * seen.x / (z * z), 0.0, k.fy / z, -k.fy * seen.y / (z * z));
        let by_point = by_point.transpose() * outward;
        // Before a camera moved by t and turned by w, a point moves by -t + p x w.
        let turn = seen.coords.cross(&by_point);
        let [t, w] = [by_point, turn];
        Some((residual, Step::from([t.x, t.y, t.z, w.x, w.y, w.z, -1.0])))
    }
}

#[cfg(test)]
#[path = "pose_tests.rs"]
mod tests;
