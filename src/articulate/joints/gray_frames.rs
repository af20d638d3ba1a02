//! Gray frames of one state, and patches of its surface averaged from them.

use nalgebra::{IsometryMatrix3, Point3, Vector3};
use rayon::prelude::*;

use crate::joints::patch_alignment::GrayPatch;
use capture::{NoiseConfig, RgbdFrame, luma};
use geometry::bilinear;

/// A reading differing from a point's depth by more than this share, beside four standard deviations, is of
/// another surface. chosen: errors of poses
const DEPTH_SHARE: f64 = 0.002;
/// Least cosine between the ray and the normal of a point with usable texture.
/// chosen: 70 degrees; texture is three times as long there
const LEAST_COSINE: f64 = 0.35;

/// A square on a surface: center, unit normal, two unit tangents, spacing of samples.
pub(crate) struct Tangent {
    pub center: Point3<f64>,
    pub normal: Vector3<f64>,
    pub axes: [Vector3<f64>; 2],
    pub spacing_m: f64,
}

/// Gray frames of one state.
pub(crate) struct GrayFrames<'a> {
    frames: &'a [RgbdFrame],
    /// Pose of the world in each camera, as matrices: they transform many points faster than quaternions.
    camera_from_world: Vec<IsometryMatrix3<f64>>,
    gray: Vec<Vec<f32>>,
    noise: &'a NoiseConfig,
}

impl<'a> GrayFrames<'a> {
    pub(crate) fn new(frames: &'a [RgbdFrame], noise: &'a NoiseConfig) -> Self {
        let gray = frames.par_iter().map(|f| f.rgb.iter().map(|c| luma(*c)).collect()).collect();
        let camera_from_world =
            frames.iter().map(|f| nalgebra::convert(f.world_from_camera.inverse())).collect();
        Self { frames, camera_from_world, gray, noise }
    }

    /// Bilinear gray value of a surface point in a frame; `None` where the frame does not see it.
    fn gray_at(&self, frame: usize, point: &Point3<f64>) -> Option<f32> {
        let f = &self.frames[frame];
        let in_camera = self.camera_from_world[frame] * point;
        let (u, v) = f.intrinsics.project(&in_camera)?;
        let w = f.intrinsics.width;
        let h = f.intrinsics.height;
        let pixel = f.intrinsics.pixel_at(u, v)?;
        let depth = f64::from(f.depth_m[pixel]);
        // A reading at another depth is of a surface in front of or behind the point, with another texture.
        if depth <= 0.0
            || !f.is_object(pixel)
            || (depth - in_camera.z).abs() > 4.0 * self.noise.sigma_m(depth) + DEPTH_SHARE * depth
        {
            return None;
        }
        if u >= (w - 1) as f64 || v >= (h - 1) as f64 {
            return None;
        }
        Some(bilinear(|i| f64::from(self.gray[frame][i]), w, h, u, v) as f32)
    }

    /// The frames with the best view of a point (most pixels per area), at most `count`, in a fixed order;
    /// and the meters per pixel of the best one.
    pub(crate) fn best_frames(
        &self,
        point: &Point3<f64>,
        normal: &Vector3<f64>,
        count: usize,
    ) -> (Vec<usize>, f64) {
        let mut scored: Vec<(f64, usize, f64)> = (0..self.frames.len())
            .filter_map(|i| {
                let f = &self.frames[i];
                let ray = point - Point3::from(f.world_from_camera.translation.vector);
                let cosine = -ray.dot(normal) / ray.norm();
                let pixel_m = (self.camera_from_world[i] * point).z / f.intrinsics.fx;
                // The score is the number of pixels per unit of surface; grazing views smear the texture.
                (cosine > LEAST_COSINE && self.gray_at(i, point).is_some()).then_some((
                    cosine / (pixel_m * pixel_m),
                    i,
                    pixel_m,
                ))
            })
            .collect();
        scored.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        scored.truncate(count);
        let pixel_m = scored.iter().map(|s| s.2).fold(f64::INFINITY, f64::min);
        (scored.iter().map(|s| s.1).collect(), pixel_m)
    }

    /// The mean patch over the given frames, sampled on a tangent square.
    pub(crate) fn mean_patch(&self, tangent: &Tangent, frames: &[usize], radius: i32) -> GrayPatch {
        let mut values = Vec::with_capacity(((2 * radius + 1) * (2 * radius + 1)) as usize);
        for v in -radius..=radius {
            for u in -radius..=radius {
                let point = tangent.center
                    + (tangent.axes[0] * f64::from(u) + tangent.axes[1] * f64::from(v)) * tangent.spacing_m;
                let mut sum = 0.0;
                let mut seen = 0;
                for &f in frames {
                    if let Some(g) = self.gray_at(f, &point) {
                        sum += g;
                        seen += 1;
                    }
                }
                // A point unseen in most of the frames is occluded in them, or off the mask.
                values.push(if 2 * seen >= frames.len().max(1) { sum / seen as f32 } else { f32::NAN });
            }
        }
        GrayPatch { radius, values }
    }
}
