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
    pub noise: NoiseConfig,
}

impl Background<'_> {
    /// The plane nearest to a point, if any.
    pub fn nearest_plane(&self, point: &Point3<f64>) -> Option<usize> {
        let height = |p: &usize| self.planes[*p].height_m(point).abs();
        (0..self.planes.len()).min_by(|a, b| height(a).total_cmp(&height(b)))
    }

    /// Whether a point is above all planes by more than the noise of its height.
    pub fn is_above(&self, frame: &RgbdFrame, pixel: usize, point: &Point3<f64>) -> bool {
        let k = &frame.intrinsics;
        let ray =
            frame.world_from_camera.rotation * k.ray_at((pixel % k.width) as f64, (pixel / k.width) as f64);
        let sigma = self.noise.sigma_m(f64::from(frame.depth_m[pixel]));
        let clear_m = |p: &Plane| PLANE_CLEARANCE_M + PLANE_SIGMAS * p.height_sigma_m(&ray, sigma);
        self.planes.iter().all(|p| p.height_m(point) > clear_m(p))
    }
}
