//! All rays of one state, for training its field (docs/method.md 12.3).

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::{FieldError, Occupancy, TrainConfig};
use capture::{RgbdFrame, dilated_mask, pixel_weights};
use geometry::{Intrinsics, Pose};
use numeric::statistics::median;

/// Range of z-depth over which rays are sampled, meters (docs/method.md 12.3).
/// chosen: no usual camera reads nearer or farther
pub(super) const NEAR_M: f64 = 0.1;
pub(super) const FAR_M: f64 = 10.0;
/// Width of the zone at the mask's border that counts neither as object nor as background, pixels.
const GUARD_PX: usize = 2;
/// Largest distance of background rays from that zone, pixels.
const RING_PX: usize = 30;

/// A pixel with usable depth on the object.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurfaceRay {
    pub frame: u16,
    pub pixel: u32,
    pub depth_m: f32,
    /// Expected standard deviation of the depth, meters.
    pub sigma_m: f32,
    /// Cosine between ray and surface normal.
    pub cosine: f32,
    pub rgb: [u8; 3],
}

/// A pixel beside the object.
#[derive(Clone, Copy, Debug)]
pub(super) struct BackgroundRay {
    pub frame: u16,
    pub pixel: u32,
    /// Depth of the pixel, meters; 0 = unknown, treated as infinite.
    pub depth_m: f32,
}

/// Camera of a frame.
#[derive(Clone, Debug)]
pub(super) struct View {
    pub intrinsics: Intrinsics,
    pub world_from_camera: Pose,
}

impl View {
    /// World origin and direction of a pixel's ray; the parameter is z-depth.
    pub(crate) fn pixel_ray(&self, pixel: u32) -> (Point3<f64>, Vector3<f64>) {
        let u = pixel as usize % self.intrinsics.width;
        let v = pixel as usize / self.intrinsics.width;
        let direction = self.world_from_camera * self.intrinsics.ray_at(u as f64, v as f64);
        (Point3::from(self.world_from_camera.translation.vector), direction)
    }
}

/// The rays of one state, in order of frames and pixels.
#[derive(Clone, Debug)]
pub(super) struct RayPool {
    pub views: Vec<View>,
    pub surface: Vec<SurfaceRay>,
    pub background: Vec<BackgroundRay>,
    /// Median expected standard deviation of the rays, meters.
    pub median_sigma_m: f64,
}

impl RayPool {
    /// Collects the rays of object pixels with usable depth in an occupied cell, and of pixels beside the
    /// mask that cross occupied cells. Object pixels without usable depth are dropped.
    ///
    /// # Errors
    /// [`FieldError::NoRays`], [`FieldError::TooManyFrames`].
    pub(crate) fn new(
        frames: &[RgbdFrame],
        occupancy: &Occupancy,
        config: &TrainConfig,
    ) -> Result<Self, FieldError> {
        if frames.len() > usize::from(u16::MAX) {
            return Err(FieldError::TooManyFrames { frames: frames.len() });
        }
        let views: Vec<View> = frames
            .iter()
            .map(|f| View { intrinsics: f.intrinsics, world_from_camera: f.world_from_camera })
            .collect();
        let rays: Vec<_> = frames
            .par_iter()
            .zip(&views)
            .enumerate()
            .map(|(i, (f, v))| frame_rays(i as u16, f, v, occupancy, config))
            .collect();
        // Joined in order of the frames, for any order of the threads.
        let mut surface = Vec::new();
        let mut background = Vec::new();
        for (s, b) in rays {
            surface.extend(s);
            background.extend(b);
        }
        if surface.is_empty() {
            return Err(FieldError::NoRays { frames: frames.len() });
        }
        let sigmas = surface.iter().map(|r| f64::from(r.sigma_m)).collect();
        let median_sigma_m = median(sigmas).unwrap_or_default();
        Ok(Self { views, surface, background, median_sigma_m })
    }

    /// The observed world point of a ray.
    pub(crate) fn observed_point(&self, ray: &SurfaceRay) -> Point3<f64> {
        let (origin, direction) = self.views[usize::from(ray.frame)].pixel_ray(ray.pixel);
        origin + direction * f64::from(ray.depth_m)
    }
}

/// Rays of one frame.
fn frame_rays(
    index: u16,
    frame: &RgbdFrame,
    view: &View,
    occupancy: &Occupancy,
    config: &TrainConfig,
) -> (Vec<SurfaceRay>, Vec<BackgroundRay>) {
    let weights = pixel_weights(frame, &config.noise);
    let mut surface = Vec::new();
    for (pixel, &cosine) in weights.iter().enumerate() {
        let depth_m = frame.depth_m[pixel];
        if cosine > 0.0
            && f64::from(depth_m) >= NEAR_M
            && f64::from(depth_m) <= FAR_M
            && frame.is_object(pixel)
        {
            let (origin, direction) = view.pixel_ray(pixel as u32);
            // Stray readings lie in no occupied cell.
            if occupancy.contains(&(origin + direction * f64::from(depth_m))) {
                let sigma_m = frame.sigma_m(pixel, &config.noise) as f32;
                surface.push(SurfaceRay {
                    frame: index,
                    pixel: pixel as u32,
                    depth_m,
                    sigma_m,
                    cosine,
                    rgb: frame.rgb[pixel],
                });
            }
        }
    }
    let mut background = Vec::new();
    if let Some(mask) = &frame.mask {
        let w = frame.intrinsics.width;
        let h = frame.intrinsics.height;
        let near = dilated_mask(mask, w, h, GUARD_PX);
        let ring = dilated_mask(mask, w, h, RING_PX + GUARD_PX);
        let mut intervals = Vec::new();
        for pixel in (0..mask.len()).filter(|&p| ring[p] && !near[p]) {
            let (origin, direction) = view.pixel_ray(pixel as u32);
            let depth_m = frame.depth_m[pixel];
            // Up to the depth of the pixel; without depth, the whole ray is empty.
            let to = if depth_m > 0.0 { f64::from(depth_m) } else { FAR_M };
            occupancy.occupied_intervals(&origin, &direction, NEAR_M, to, &mut intervals);
            if !intervals.is_empty() {
                background.push(BackgroundRay { frame: index, pixel: pixel as u32, depth_m });
            }
        }
    }
    (surface, background)
}
