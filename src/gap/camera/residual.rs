//! Measured less predicted depth, pixel by pixel: what agrees well enough to be compared, and what conflicts.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::{
    frames::{FrameRun, true_camera},
    parameter::Seen,
    twin::{Hypothesis, SeenTwin},
};
use crate::{
    capture::pixel_weights,
    geometry::Pose,
    surface::{RenderItem, Rendered, render},
};

/// Pixels of the object that are looked at in a frame, about.
const SAMPLES: f64 = 2500.0;
/// Bend of the surface across three pixels above which its normal is not used, metres.
const MAX_BEND_M: f64 = 0.0015;
/// Surfaces seen at a smaller cosine are not compared.
const LEAST_COSINE: f64 = 0.2;
/// Error of a pixel's place, pixels.
const PIXEL_SIGMA: f64 = 0.3;
/// Errors of rendering and rounding, metres.
const FLOOR_M: f64 = 0.0003;
/// Pixels within this many of an outline are not compared.
pub const BORDER: usize = 2;

/// How a measured pixel conflicts with the twin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Conflict {
    /// The object is seen before the twin's surface, or where the twin has none.
    Nearer,
    /// The object is seen behind the twin's surface.
    Farther,
    /// The twin has a surface where the object is not.
    Empty,
}

/// What became of a sampled pixel.
#[derive(Clone, Copy, Debug)]
pub enum Sample {
    /// Surface and reading belong together: residual across the surface and its standard deviation, metres.
    Match {
        /// What is seen.
        seen: Seen,
        /// Measured less predicted, metres, positive towards the camera.
        residual_m: f64,
        /// Standard deviation expected of the camera.
        sigma_m: f64,
        /// World point measured.
        measured: nalgebra::Point3<f64>,
    },
    /// They do not; the world point measured (predicted, where nothing was) and the part predicted.
    Conflict {
        /// How.
        kind: Conflict,
        /// World point.
        point: nalgebra::Point3<f64>,
        /// Part that the twin has there.
        part: Option<usize>,
    },
}

impl Sample {
    /// World point measured; the predicted one where nothing was.
    #[must_use]
    pub fn measured(&self) -> nalgebra::Point3<f64> {
        match self {
            Self::Match { measured, .. } => *measured,
            Self::Conflict { point, .. } => *point,
        }
    }
}

/// A sampled pixel with its place.
#[derive(Clone, Copy, Debug)]
pub struct PixelSample {
    /// Run.
    pub run: usize,
    /// Frame in the run.
    pub frame: usize,
    /// Pixel index.
    pub pixel: usize,
    /// Area that it stands for, square metres on a surface facing the camera.
    pub area_m2: f64,
    /// What became of it.
    pub sample: Sample,
}

/// What does not change from hypothesis to hypothesis: usable pixels of every frame.
pub struct Pixels {
    /// Sampled pixel indices with a reading on the object, by run and frame.
    object: Vec<Vec<Vec<usize>>>,
    /// Sampled pixel indices off the object, by run and frame.
    empty: Vec<Vec<Vec<usize>>>,
    /// Side of the sampling grid, by run and frame.
    stride: Vec<Vec<usize>>,
}

impl Pixels {
    /// Chooses the pixels: on a grid, away from depth edges and from the mask's border.
    #[must_use]
    pub fn choose(runs: &[FrameRun]) -> Self {
        let mut pixels = Self { object: Vec::new(), empty: Vec::new(), stride: Vec::new() };
        for run in runs {
            let chosen: Vec<_> = run.frames.par_iter().map(|f| choose(f, run)).collect();
            let (mut object, mut empty, mut stride) = (Vec::new(), Vec::new(), Vec::new());
            for (o, e, s) in chosen {
                object.push(o);
                empty.push(e);
                stride.push(s);
            }
            pixels.object.push(object);
            pixels.empty.push(empty);
            pixels.stride.push(stride);
        }
        pixels
    }

    /// Side of the sampling grid of a frame, pixels.
    #[must_use]
    pub fn stride_of(&self, run: usize, frame: usize) -> usize {
        self.stride[run][frame]
    }
}

fn choose(frame: &crate::capture::RgbdFrame, run: &FrameRun) -> (Vec<usize>, Vec<usize>, usize) {
    let (w, h) = (frame.intrinsics.width, frame.intrinsics.height);
    let weights = pixel_weights(frame, &run.noise);
    let usable = |i: usize| weights[i] > 0.0 && frame.is_object(i);
    let count = (0..w * h).filter(|&i| usable(i)).count();
    let stride = ((count as f64 / SAMPLES).sqrt().round() as usize).max(1);
    let grid = (0..h).step_by(stride).flat_map(|y| (0..w).step_by(stride).map(move |x| y * w + x));
    let object = grid.clone().filter(|&i| usable(i)).collect();
    let off = |i: usize| frame.mask.is_some() && around(i, w, h).all(|n| !frame.is_object(n));
    let empty = grid.filter(|&i| off(i)).collect();
    (object, empty, stride)
}

/// Pixels about a pixel that a border reaches.
fn around(i: usize, w: usize, h: usize) -> impl Iterator<Item = usize> {
    let (x, y) = (i % w, i / w);
    let columns = x.saturating_sub(BORDER)..=(x + BORDER).min(w - 1);
    let rows = y.saturating_sub(BORDER)..=(y + BORDER).min(h - 1);
    rows.flat_map(move |y| columns.clone().map(move |x| y * w + x))
}

/// Renders the twin as a frame's camera would see it.
#[must_use]
pub fn predict(twin: &SeenTwin, poses: &[Pose], intrinsics: &crate::geometry::Intrinsics, camera: &Pose, shading: bool) -> Rendered {
    let items: Vec<RenderItem> =
        twin.parts.iter().zip(poses).map(|(p, pose)| RenderItem { mesh: &p.mesh, world_from_mesh: *pose, tint: None }).collect();
    render(&items, intrinsics, camera, shading)
}

/// Compares all runs with a hypothesis; residuals beyond `gate_m` are conflicts.
#[must_use]
pub fn compare(twin: &SeenTwin, runs: &[FrameRun], pixels: &Pixels, hypothesis: &Hypothesis, gate_m: f64) -> Vec<PixelSample> {
    let all: Vec<(usize, usize)> = runs.iter().enumerate().flat_map(|(r, run)| (0..run.frames.len()).map(move |f| (r, f))).collect();
    let poses: Vec<Vec<Pose>> = (0..runs.len()).map(|r| hypothesis.poses(twin, r).0).collect();
    let of = |&(run, frame): &(usize, usize)| {
        let camera = true_camera(&runs[run], frame, &hypothesis.camera);
        let image = predict(twin, &poses[run], &runs[run].frames[frame].intrinsics, &camera, false);
        let view = FrameView { run, frame, data: &runs[run], image: &image, hypothesis, gate_m };
        let object = pixels.object[run][frame].iter().filter_map(|&i| view.object_sample(i).map(|s| (i, s)));
        let empty = pixels.empty[run][frame].iter().filter_map(|&i| view.empty_sample(i).map(|s| (i, s)));
        let stride = pixels.stride[run][frame] as f64;
        let focal = image.intrinsics.fx;
        object
            .chain(empty)
            .map(|(pixel, sample)| {
                let depth_m = match &sample {
                    Sample::Match { seen, .. } => seen.depth_m,
                    Sample::Conflict { point, .. } => camera.inverse_transform_point(point).z,
                };
                PixelSample { run, frame, pixel, area_m2: (stride * depth_m / focal).powi(2), sample }
            })
            .collect::<Vec<_>>()
    };
    all.par_iter().map(of).collect::<Vec<_>>().concat()
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
    fn ray(&self, i: usize) -> Vector3<f64> {
        let k = &self.image.intrinsics;
        k.ray((i % k.width) as f64, (i / k.width) as f64)
    }

    fn point(&self, i: usize, depth_m: f64) -> nalgebra::Point3<f64> {
        self.image.world_from_camera * nalgebra::Point3::from(self.ray(i) * depth_m)
    }

    /// Normal of the predicted surface in the camera, towards it; `None` at edges and bends.
    fn normal(&self, i: usize) -> Option<Vector3<f64>> {
        let k = &self.image.intrinsics;
        let (x, y) = (i % k.width, i / k.width);
        if x == 0 || y == 0 || x + 1 >= k.width || y + 1 >= k.height {
            return None;
        }
        let item = self.image.item[i]?;
        let inverse = |n: usize| (self.image.item[n] == Some(item)).then(|| 1.0 / f64::from(self.image.depth_m[n]));
        let (here, left, right) = (inverse(i)?, inverse(i - 1)?, inverse(i + 1)?);
        let (up, down) = (inverse(i - k.width)?, inverse(i + k.width)?);
        // The inverse depth of a plane is linear in the image.
        let bend = (left + right - 2.0 * here).abs().max((up + down - 2.0 * here).abs()) / (here * here);
        if bend > MAX_BEND_M {
            return None;
        }
        // On a plane n . ray = n . p / z: the slopes of 1/z give the normal.
        let (gx, gy) = (0.5 * (right - left) * k.fx, 0.5 * (down - up) * k.fy);
        let ray = self.ray(i);
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
            let alone = around(i, k.width, k.height).all(|n| self.image.item[n].is_none());
            // Without a mask nothing tells that the pixel shows the object.
            return (alone && frame.mask.is_some()).then(|| Sample::Conflict {
                kind: Conflict::Nearer,
                point: self.point(i, measured_m),
                part: None,
            });
        };
        let predicted_m = f64::from(self.image.depth_m[i]);
        let off_m = measured_m - predicted_m;
        let conflict = |kind| Sample::Conflict { kind, point: self.point(i, measured_m), part: Some(item as usize) };
        let kind = if off_m < 0.0 { Conflict::Nearer } else { Conflict::Farther };
        let normal = self.normal(i);
        let ray = self.ray(i);
        let Some((n, slant)) = normal.map(|n| (n, n.dot(&ray))).filter(|(_, s)| -s / ray.norm() > LEAST_COSINE) else {
            return (off_m.abs() > 3.0 * self.gate_m).then(|| conflict(kind));
        };
        let residual_m = slant * off_m * camera.scale;
        if residual_m.abs() > self.gate_m {
            return Some(conflict(kind));
        }
        let sigma_m = {
            let across = slant * frame.sigma_m(i, &self.data.noise);
            let aside = PIXEL_SIGMA * predicted_m / k.fx * (ray.norm_squared() - slant * slant).max(0.0).sqrt();
            (across * across + aside * aside + FLOOR_M * FLOOR_M).sqrt()
        };
        let seen = Seen {
            run: self.run,
            frame: self.frame,
            part: item as usize,
            point: self.point(i, predicted_m),
            normal: self.image.world_from_camera.rotation * n,
            camera: self.image.world_from_camera,
            depth_m: predicted_m,
            slant,
        };
        Some(Sample::Match { seen, residual_m, sigma_m, measured: self.point(i, measured_m) })
    }

    fn empty_sample(&self, i: usize) -> Option<Sample> {
        let item = self.image.item[i]?;
        let k = &self.image.intrinsics;
        if !around(i, k.width, k.height).all(|n| self.image.item[n].is_some()) {
            return None;
        }
        let predicted_m = f64::from(self.image.depth_m[i]);
        let reading = f64::from(self.data.frames[self.frame].depth_m[i]);
        // Something else may stand before the object.
        let behind = reading > predicted_m + self.gate_m;
        (reading == 0.0 || behind).then(|| Sample::Conflict {
            kind: Conflict::Empty,
            point: self.point(i, predicted_m),
            part: Some(item as usize),
        })
    }
}
