//! The depth readings of a view, prepared for the map.

use nalgebra::Point3;

use crate::tsdf_view::{Reading, TsdfView, object_roles};
use capture::{NoiseConfig, RgbdFrame, pixel_weights};
use geometry::Pose;
use numeric::statistics::median;

/// Beyond this depth a reading only shows the empty space in front of it, meters.
/// chosen: there three standard deviations of a reading are 7 cm, as much as many parts move
pub(super) const MAX_DEPTH_M: f32 = 3.0;
/// One of this many pixels counts for the median.
const EVERY: usize = 97;
/// Cameras farther from the world's origin are taken for pose errors, meters.
/// chosen: no site is as wide
const FARTHEST_M: f64 = 1e5;

/// A view with its readings.
pub(super) struct ViewDepth<'a> {
    /// The view.
    pub frame: &'a RgbdFrame,
    /// Pose of the world in the optical frame.
    pub camera_from_world: Pose,
    /// Reading of each pixel.
    pub readings: Vec<Reading>,
    /// Cosine between ray and surface of each pixel; 0 where it is unknown.
    pub cosines: Vec<f32>,
    /// Noise of the readings.
    pub noise: NoiseConfig,
    /// Median depth of the seen surface, meters.
    pub median_m: f64,
}

impl<'a> ViewDepth<'a> {
    /// The readings of a frame; `None` where it reads no surface, or its pose, camera or sizes make no sense.
    pub(super) fn new(frame: &'a RgbdFrame, noise: &NoiseConfig) -> Option<Self> {
        if !is_sound(frame) {
            return None;
        }
        let cosines = pixel_weights(frame, noise);
        let roles = object_roles(frame, &cosines);
        let mut readings = TsdfView::new(frame, &cosines, &roles, Pose::identity(), noise).readings;
        for r in readings.iter_mut().filter(|r| r.depth_m > MAX_DEPTH_M) {
            *r = Reading::of_free_space(f32::INFINITY, r.weight());
        }
        let surface = readings.iter().step_by(EVERY).filter(|r| r.is_surface());
        let median_m = median(surface.map(|r| f64::from(r.depth_m)).collect())?;
        Some(Self {
            frame,
            camera_from_world: frame.world_from_camera.inverse(),
            readings,
            cosines,
            noise: *noise,
            median_m,
        })
    }

    /// Position of the camera in the world.
    pub(super) fn eye(&self) -> Point3<f64> {
        self.frame.world_from_camera.translation.vector.into()
    }

    /// Width of a pixel at a depth, meters.
    pub(super) fn pixel_m(&self, depth_m: f64) -> f64 {
        depth_m / self.frame.intrinsics.fx.max(self.frame.intrinsics.fy)
    }
}

fn is_sound(frame: &RgbdFrame) -> bool {
    let k = &frame.intrinsics;
    let count = k.width.saturating_mul(k.height);
    let pose = &frame.world_from_camera;
    count > 0
        && frame.depth_m.len() == count
        && frame.rgb.len() == count
        && frame.mask.as_ref().is_none_or(|m| m.len() == count)
        && [k.fx, k.fy].iter().all(|f| f.is_finite() && *f > 0.0)
        && [k.cx, k.cy].iter().all(|c| c.is_finite())
        && pose.translation.vector.iter().all(|v| v.abs() < FARTHEST_M)
        && pose.rotation.coords.iter().all(|v| v.is_finite())
}
