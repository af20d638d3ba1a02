//! The background planes below or behind the object, and the workspace box.

use nalgebra::Point3;

use super::plane::Plane;
use crate::{CaptureConfig, NoiseConfig, RgbdFrame};

/// Points closer to the support plane than this belong to it, meters.
/// chosen: what lies on a plane is higher
pub const PLANE_CLEARANCE_M: f64 = 0.002;
/// Points closer to it than this many standard deviations of the depth noise belong to it, too.
/// chosen: 0.1 % of the plane's readings lie farther above it
const PLANE_SIGMAS: f64 = 3.0;

/// Whether a point lies in the workspace; true without one.
pub fn in_box(workspace: Option<[[f64; 3]; 2]>, p: &Point3<f64>) -> bool {
    workspace.is_none_or(|[lower, upper]| (0..3).all(|k| p[k] >= lower[k] && p[k] <= upper[k]))
}

/// The planes taken as background.
pub struct Background<'a> {
    pub planes: Vec<Plane>,
    pub config: &'a CaptureConfig,
    /// Depth noise with all errors of readings.
    pub noise: NoiseConfig,
}

impl Background<'_> {
    /// The planes that are background at a point.
    pub fn planes_at(&self, point: &Point3<f64>) -> impl Iterator<Item = usize> {
        (0..self.planes.len()).filter(|p| self.planes[*p].is_background_at(point))
    }

    /// The plane nearest to a point, if any.
    pub fn nearest_plane(&self, point: &Point3<f64>) -> Option<usize> {
        let height = |p: &usize| self.planes[*p].height_m(point).abs();
        self.planes_at(point).min_by(|a, b| height(a).total_cmp(&height(b)))
    }

    /// Whether a point is less than a height over a plane.
    pub fn is_near_plane(&self, point: &Point3<f64>, height_m: f64) -> bool {
        self.planes_at(point).any(|p| self.planes[p].height_m(point) < height_m)
    }

    /// Whether a point is above all planes by more than the noise of its height.
    pub fn is_above(&self, frame: &RgbdFrame, pixel: usize, point: &Point3<f64>) -> bool {
        let k = &frame.intrinsics;
        let ray =
            frame.world_from_camera.rotation * k.ray_at((pixel % k.width) as f64, (pixel / k.width) as f64);
        let sigma = self.noise.sigma_m(f64::from(frame.depth_m[pixel]));
        let clear_m = |p: &Plane| PLANE_CLEARANCE_M + PLANE_SIGMAS * p.height_sigma_m(&ray, sigma);
        self.planes_at(point).all(|p| self.planes[p].height_m(point) > clear_m(&self.planes[p]))
    }
}
