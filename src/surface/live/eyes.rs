//! Camera poses of the views of a state, thinned to a bounded number.

use nalgebra::{Point3, Vector3};

use super::view_depth::{MAX_DEPTH_M, ViewDepth};
use capture::common_focus;
use geometry::{Intrinsics, Pose};
use numeric::statistics::median;

/// Largest number of remembered views; when it is exceeded, every second one is dropped.
const MOST: usize = 128;

/// The views of a state.
pub(super) struct Eyes {
    /// Pose and median depth (meters) of the remembered views.
    views: Vec<(Pose, f64)>,
    /// One of this many views is remembered.
    every: usize,
    /// Number of views so far.
    pub count: usize,
    /// Camera of the last view.
    pub intrinsics: Intrinsics,
}

/// The common focus of the views.
pub(super) struct Focus {
    /// The point they look at.
    pub point: Point3<f64>,
    /// Median distance of the cameras to it, meters.
    pub distance_m: f64,
    /// Up: the axis of the world nearest to the cameras' upward direction (REP 103 makes it z).
    pub up: Vector3<f64>,
    /// Sine of the lowest elevation of a camera, seen from the point.
    pub lowest: f64,
}

impl Eyes {
    /// No views yet; the camera is `intrinsics`.
    pub(super) fn new(intrinsics: Intrinsics) -> Self {
        Self { views: Vec::new(), every: 1, count: 0, intrinsics }
    }

    /// Remembers a view.
    pub(super) fn remember_view(&mut self, view: &ViewDepth) {
        self.intrinsics = view.frame.intrinsics;
        if self.count.is_multiple_of(self.every) {
            self.views.push((view.frame.world_from_camera, view.median_m));
        }
        self.count += 1;
        if self.views.len() > MOST {
            let all = std::mem::take(&mut self.views);
            self.views = all.into_iter().step_by(2).collect();
            self.every *= 2;
        }
    }

    /// The point the views look at; `None` without views.
    fn common_point(&self) -> Option<Focus> {
        let poses: Vec<Pose> = self.views.iter().map(|v| v.0).collect();
        let ahead: Vec<Point3<f64>> = self.views.iter().map(|(p, z)| p * Point3::new(0.0, 0.0, *z)).collect();
        let along = |k: usize| median(ahead.iter().map(|p| p[k]).collect());
        let middle = Point3::new(along(0)?, along(1)?, along(2)?);
        let point = common_focus(&poses).filter(|p| is_before_all(p, &poses, &ahead)).unwrap_or(middle);
        let out = |p: &Pose| p.translation.vector - point.coords;
        let distance_m = median(poses.iter().map(|p| out(p).norm()).collect())?.max(1e-3);
        let sum: Vector3<f64> = poses.iter().map(|p| p.rotation * -Vector3::y()).sum();
        let axis = sum.iamax();
        let up = Vector3::ith(axis, if sum[axis] < 0.0 { -1.0 } else { 1.0 });
        let lowest = poses.iter().map(|p| out(p).normalize().dot(&up)).fold(1.0, f64::min);
        Some(Focus { point, distance_m, up, lowest })
    }

    /// The largest ball around the focus that fits in the image at the views' median distance: focus and
    /// radius, meters.
    pub(super) fn focus_ball(&self) -> Option<(Focus, f64)> {
        let focus = self.common_point()?;
        let k = &self.intrinsics;
        let half = (0.5 * k.width as f64 / k.fx).min(0.5 * k.height as f64 / k.fy);
        let radius_m = focus.distance_m * half.atan().sin();
        Some((focus, radius_m))
    }

    /// Whether a point is in the image of at least half of the views.
    pub(super) fn half_show(&self, point: &Point3<f64>) -> bool {
        let pixels =
            self.views.iter().map(|(pose, _)| self.intrinsics.pixel_of(&pose.inverse_transform_point(point)));
        2 * pixels.flatten().count() >= self.views.len()
    }
}

/// Whether a point is about as near to every camera as the surface `ahead` of it. A point where all axes meet
/// far from the seen surface, e.g. on a walk, is no focus.
fn is_before_all(p: &Point3<f64>, poses: &[Pose], ahead: &[Point3<f64>]) -> bool {
    ahead.iter().zip(poses).all(|(a, pose)| {
        let to_m = (p - Point3::from(pose.translation.vector)).norm();
        (p - a).norm() <= to_m && to_m < 2.0 * f64::from(MAX_DEPTH_M)
    })
}
