//! Measured minus predicted depth, pixel by pixel: comparable pixels and conflicting ones.
//! See docs/method.md (15.3).

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::camera::{
    fit::{
        predict::{rendered_twin, true_camera},
        sample::{Conflict, PixelSample, Sample},
    },
    model::{hypothesis::Hypothesis, posed::SurfacePoint, twin::SeenTwin},
    record::{
        frames::FrameRun,
        pixels::{Pixels, pixels_around},
    },
};
use geometry::Pose;
use surface::Rendered;

/// Largest bend of the surface across three pixels for a usable normal, in units of the pixel spacing there.
///
/// chosen: the slope between the outer two is off by half of it at most, so the normal by 0.15 rad, and the
/// residual across the surface by 1 %
const BEND: f64 = 0.3;
/// Standard deviation of a pixel's position, pixels.
///
/// derived: uniform over a pixel, 1 / sqrt(12)
const PIXEL_SIGMA: f64 = 0.289;
/// Standard deviation of rounding the depth, meters.
///
/// derived: 16UC1 has whole millimeters, 1 mm / sqrt(12)
const ROUNDING_M: f64 = 0.000_289;

/// Compares all runs with a hypothesis; residuals beyond `gate_m` are conflicts.
pub fn compared_pixels(
    twin: &SeenTwin,
    runs: &[FrameRun],
    pixels: &Pixels,
    hypothesis: &Hypothesis,
    gate_m: f64,
) -> Vec<PixelSample> {
    let all: Vec<(usize, usize)> =
        runs.iter().enumerate().flat_map(|(r, run)| (0..run.frames.len()).map(move |f| (r, f))).collect();
    let poses: Vec<Vec<Pose>> = (0..runs.len()).map(|r| hypothesis.part_and_joint_poses(twin, r).0).collect();
    let samples_of_frames: Vec<Vec<PixelSample>> = all
        .par_iter()
        .map(|&(run, frame)| {
            let camera = true_camera(&runs[run], frame, &hypothesis.camera);
            let image = rendered_twin(twin, &poses[run], &runs[run].frames[frame].intrinsics, &camera, false);
            FrameView { run, frame, data: &runs[run], image: &image, hypothesis, gate_m }
                .frame_samples(pixels)
        })
        .collect();
    samples_of_frames.concat()
}

/// A frame and its prediction.
struct FrameView<'a> {
    run: usize,
    frame: usize,
    data: &'a FrameRun,
    image: &'a Rendered,
    hypothesis: &'a Hypothesis,
    gate_m: f64,
}

impl FrameView<'_> {
    /// The compared pixels: first those on the object, then those off it.
    fn frame_samples(&self, pixels: &Pixels) -> Vec<PixelSample> {
        let mut samples = Vec::new();
        for &i in &pixels.object[self.run][self.frame] {
            samples.extend(self.object_sample(i).map(|s| self.pixel_sample(pixels, i, s)));
        }
        for &i in &pixels.empty[self.run][self.frame] {
            samples.extend(self.empty_sample(i).map(|s| self.pixel_sample(pixels, i, s)));
        }
        samples
    }

    /// A sample with its pixel index and area.
    fn pixel_sample(&self, pixels: &Pixels, pixel: usize, sample: Sample) -> PixelSample {
        let stride = pixels.stride[self.run][self.frame] as f64;
        let depth_m = match &sample {
            Sample::Match { seen, .. } => seen.depth_m,
            Sample::Conflict { point, .. } => self.image.world_from_camera.inverse_transform_point(point).z,
        };
        let area_m2 = (stride * depth_m / self.image.intrinsics.fx).powi(2);
        PixelSample { run: self.run, frame: self.frame, pixel, area_m2, sample }
    }

    fn pixel_ray(&self, i: usize) -> Vector3<f64> {
        let k = &self.image.intrinsics;
        k.ray_at((i % k.width) as f64, (i / k.width) as f64)
    }

    fn world_point(&self, i: usize, depth_m: f64) -> nalgebra::Point3<f64> {
        self.image.world_from_camera * nalgebra::Point3::from(self.pixel_ray(i) * depth_m)
    }

    /// Unit normal of the predicted surface in the camera frame, towards the camera; `None` at edges and
    /// bends.
    fn predicted_normal(&self, i: usize) -> Option<Vector3<f64>> {
        let k = &self.image.intrinsics;
        let x = i % k.width;
        let y = i / k.width;
        if x == 0 || y == 0 || x + 1 >= k.width || y + 1 >= k.height {
            return None;
        }
        let item = self.image.item[i]?;
        let inverse =
            |n: usize| (self.image.item[n] == Some(item)).then(|| 1.0 / f64::from(self.image.depth_m[n]));
        let here = inverse(i)?;
        let left = inverse(i - 1)?;
        let right = inverse(i + 1)?;
        let up = inverse(i - k.width)?;
        let down = inverse(i + k.width)?;
        // The inverse depth of a plane is linear in the image.
        let bend = (left + right - 2.0 * here).abs().max((up + down - 2.0 * here).abs()) / (here * here);
        if bend > BEND / (here * k.fx) {
            return None;
        }
        // On a plane n . ray = n . p / z: the slopes of 1/z give the normal.
        let gx = 0.5 * (right - left) * k.fx;
        let gy = 0.5 * (down - up) * k.fy;
        let ray = self.pixel_ray(i);
        let n = Vector3::new(gx, gy, here - gx * ray.x - gy * ray.y).normalize();
        Some(if n.dot(&ray) > 0.0 { -n } else { n })
    }

    fn object_sample(&self, i: usize) -> Option<Sample> {
        let frame = &self.data.frames[self.frame];
        let camera = &self.hypothesis.camera;
        let reading = f64::from(frame.depth_m[i]);
        let measured_m = (reading - camera.bias_m) / camera.scale;
        let k = &self.image.intrinsics;
        let Some(item) = self.image.item[i] else {
            // At the outline, an error of half a pixel would make a conflict.
            let alone = pixels_around(i, k.width, k.height).all(|n| self.image.item[n].is_none());
            // Without a mask the pixel may show something else.
            return (alone && frame.mask.is_some()).then(|| Sample::Conflict {
                kind: Conflict::Nearer,
                point: self.world_point(i, measured_m),
                part: None,
            });
        };
        let predicted_m = f64::from(self.image.depth_m[i]);
        let off_m = measured_m - predicted_m;
        let part = Some(item as usize);
        let conflict = |kind| Sample::Conflict { kind, point: self.world_point(i, measured_m), part };
        let kind = if off_m < 0.0 { Conflict::Nearer } else { Conflict::Farther };
        let normal = self.predicted_normal(i);
        let ray = self.pixel_ray(i);
        let Some((n, slant)) = normal
            .map(|n| (n, n.dot(&ray)))
            .filter(|(_, s)| -s / ray.norm() > self.data.noise.grazing_cosine)
        else {
            // Without a normal the residual across the surface is unknown: only a difference along the ray
            // beyond the gate at the most grazing angle used counts.
            return (off_m.abs() * self.data.noise.grazing_cosine > self.gate_m).then(|| conflict(kind));
        };
        // (15.3)
        let residual_m = slant * off_m * camera.scale;
        if residual_m.abs() > self.gate_m {
            return Some(conflict(kind));
        }
        // docs/method.md (15.4).
        let sigma_m = {
            let across = slant * frame.sigma_m(i, &self.data.noise);
            let aside =
                PIXEL_SIGMA * predicted_m / k.fx * (ray.norm_squared() - slant * slant).max(0.0).sqrt();
            (across * across + aside * aside + ROUNDING_M * ROUNDING_M).sqrt()
        };
        let seen = SurfacePoint {
            run: self.run,
            frame: self.frame,
            part: item as usize,
            point: self.world_point(i, predicted_m),
            normal: self.image.world_from_camera.rotation * n,
            camera: self.image.world_from_camera,
            depth_m: predicted_m,
            slant,
        };
        Some(Sample::Match { seen, residual_m, sigma_m, measured: self.world_point(i, measured_m) })
    }

    fn empty_sample(&self, i: usize) -> Option<Sample> {
        let item = self.image.item[i]?;
        let k = &self.image.intrinsics;
        if !pixels_around(i, k.width, k.height).all(|n| self.image.item[n].is_some()) {
            return None;
        }
        let predicted_m = f64::from(self.image.depth_m[i]);
        let reading = f64::from(self.data.frames[self.frame].depth_m[i]);
        // Something else may be in front of the object.
        let behind = reading > predicted_m + self.gate_m;
        (reading == 0.0 || behind).then(|| Sample::Conflict {
            kind: Conflict::Empty,
            point: self.world_point(i, predicted_m),
            part: Some(item as usize),
        })
    }
}
