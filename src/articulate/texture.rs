//! Surface texture aligned between the states: dense matches where pixel features are few.
//!
//! Around a surface point the frames of one state are averaged on the tangent plane into a small patch. Warped by the
//! part's motion, the same patch is looked for on the other state's surface by Lucas-Kanade with normalised
//! brightness, so that shading may change. A patch holds the surface in its own plane, where distance fields say nothing.

use nalgebra::{Matrix2, Matrix3, Point3, Vector2, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{MatchEvidence, SurfaceSamples};
use crate::{
    capture::{NoiseConfig, RgbdFrame},
    geometry::{Grid3, Pose},
};

/// Settings of the texture alignment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TextureConfig {
    /// Surface points tried per part and state.
    pub points: usize,
    /// Frames averaged into a patch at most.
    pub frames: usize,
    /// Distance between patch samples, in pixels of the closest camera.
    pub spacing_pixels: f64,
    /// Smallest contrast of a patch (standard deviation of the gray value, 0 to 1).
    pub min_contrast: f64,
    /// Smallest normalised correlation of an aligned pair.
    pub min_correlation: f64,
    /// Smallest standard deviation of an aligned patch, pixels of the closest camera.
    pub pixel_sigma: f64,
}

impl Default for TextureConfig {
    fn default() -> Self {
        Self { points: 3000, frames: 8, spacing_pixels: 2.0, min_contrast: 0.015, min_correlation: 0.8, pixel_sigma: 0.5 }
    }
}

/// Samples on each side of a patch's centre.
const RADIUS: i32 = 4;
/// Largest shift that is looked for, in patch samples.
const REACH: i32 = 4;
/// Lucas-Kanade iterations.
const ITERATIONS: usize = 12;
/// Share of a patch that must be seen.
const MIN_SEEN: f64 = 0.9;

/// Gray values on a square of `2 radius + 1` samples a side; NaN where no frame saw the surface.
struct Patch {
    radius: i32,
    values: Vec<f32>,
}

impl Patch {
    fn at(&self, u: i32, v: i32) -> f32 {
        let side = 2 * self.radius + 1;
        self.values[((v + self.radius) * side + u + self.radius) as usize]
    }

    /// Bilinear value; NaN outside or where a neighbour was not seen.
    fn sample(&self, u: f64, v: f64) -> f64 {
        let (x, y) = (u.floor() as i32, v.floor() as i32);
        if x < -self.radius || y < -self.radius || x >= self.radius || y >= self.radius {
            return f64::NAN;
        }
        let (a, b) = (u - f64::from(x), v - f64::from(y));
        let f = |i: i32, j: i32| f64::from(self.at(x + i, y + j));
        (f(0, 0) * (1.0 - a) + f(1, 0) * a) * (1.0 - b) + (f(0, 1) * (1.0 - a) + f(1, 1) * a) * b
    }
}

/// A square on a surface: centre, unit normal, two unit tangents, spacing of samples.
struct Tangent {
    center: Point3<f64>,
    normal: Vector3<f64>,
    axes: [Vector3<f64>; 2],
    spacing_m: f64,
}

/// Gray frames of one state.
struct GrayFrames<'a> {
    frames: &'a [RgbdFrame],
    gray: Vec<Vec<f32>>,
    noise: &'a NoiseConfig,
}

impl<'a> GrayFrames<'a> {
    fn new(frames: &'a [RgbdFrame], noise: &'a NoiseConfig) -> Self {
        let luma = |c: &[u8; 3]| (0.299 * f32::from(c[0]) + 0.587 * f32::from(c[1]) + 0.114 * f32::from(c[2])) / 255.0;
        Self { frames, gray: frames.par_iter().map(|f| f.rgb.iter().map(luma).collect()).collect(), noise }
    }

    /// Bilinear gray value of a surface point in a frame; `None` where the frame does not see it.
    fn see(&self, frame: usize, point: &Point3<f64>) -> Option<f32> {
        let f = &self.frames[frame];
        let in_camera = f.in_camera(point);
        let pixel = f.intrinsics.pixel(&in_camera)?;
        let depth = f64::from(f.depth_m[pixel]);
        if depth <= 0.0 || !f.is_object(pixel) || (depth - in_camera.z).abs() > 4.0 * self.noise.sigma_m(depth) + 0.002 * depth {
            return None;
        }
        let (u, v) = f.intrinsics.project(&in_camera)?;
        let (w, h) = (f.intrinsics.width, f.intrinsics.height);
        let (x, y) = (u.max(0.0) as usize, v.max(0.0) as usize);
        if x + 1 >= w || y + 1 >= h {
            return None;
        }
        let (a, b) = ((u - x as f64) as f32, (v - y as f64) as f32);
        let g = |i: usize, j: usize| self.gray[frame][(y + j) * w + x + i];
        Some((g(0, 0) * (1.0 - a) + g(1, 0) * a) * (1.0 - b) + (g(0, 1) * (1.0 - a) + g(1, 1) * a) * b)
    }

    /// Frames that see a point best: most pixels per area, at most `count`, in a fixed order; with the metres per pixel
    /// of the best one.
    fn best(&self, point: &Point3<f64>, normal: &Vector3<f64>, count: usize) -> (Vec<usize>, f64) {
        let mut scored: Vec<(f64, usize, f64)> = (0..self.frames.len())
            .filter_map(|i| {
                let f = &self.frames[i];
                let ray = point - Point3::from(f.world_from_camera.translation.vector);
                let cosine = -ray.dot(normal) / ray.norm();
                let pixel_m = f.in_camera(point).z / f.intrinsics.fx;
                (cosine > 0.35 && self.see(i, point).is_some()).then_some((cosine / (pixel_m * pixel_m), i, pixel_m))
            })
            .collect();
        scored.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        scored.truncate(count);
        let pixel_m = scored.iter().map(|s| s.2).fold(f64::INFINITY, f64::min);
        (scored.iter().map(|s| s.1).collect(), pixel_m)
    }

    /// The mean patch of the given frames on a tangent square.
    fn patch(&self, tangent: &Tangent, frames: &[usize], radius: i32) -> Patch {
        let mut values = Vec::with_capacity(((2 * radius + 1) * (2 * radius + 1)) as usize);
        for v in -radius..=radius {
            for u in -radius..=radius {
                let point = tangent.center + (tangent.axes[0] * f64::from(u) + tangent.axes[1] * f64::from(v)) * tangent.spacing_m;
                let (mut sum, mut seen) = (0.0, 0);
                for &f in frames {
                    if let Some(g) = self.see(f, &point) {
                        sum += g;
                        seen += 1;
                    }
                }
                values.push(if 2 * seen >= frames.len().max(1) { sum / seen as f32 } else { f32::NAN });
            }
        }
        Patch { radius, values }
    }
}

/// Shift in patch samples, its covariance and the correlation, of a patch in a larger one. `None` without contrast,
/// outside the reach, or if the search does not converge.
fn align(reference: &Patch, target: &Patch, min_contrast: f64) -> Option<(Vector2<f64>, Matrix2<f64>, f64)> {
    let mut shift = Vector2::zeros();
    let mut last = None;
    for _ in 0..ITERATIONS {
        let mut rows: Vec<(f64, f64, Vector2<f64>)> = Vec::new();
        for v in -RADIUS..=RADIUS {
            for u in -RADIUS..=RADIUS {
                let (x, y) = (f64::from(u) + shift.x, f64::from(v) + shift.y);
                let a = f64::from(reference.at(u, v));
                let b = target.sample(x, y);
                let gradient = Vector2::new(
                    target.sample(x + 0.5, y) - target.sample(x - 0.5, y),
                    target.sample(x, y + 0.5) - target.sample(x, y - 0.5),
                );
                if a.is_finite() && b.is_finite() && gradient.x.is_finite() && gradient.y.is_finite() {
                    rows.push((a, b, gradient));
                }
            }
        }
        let n = rows.len() as f64;
        if n < MIN_SEEN * f64::from((2 * RADIUS + 1).pow(2)) {
            return None;
        }
        let (ma, mb) = (rows.iter().map(|r| r.0).sum::<f64>() / n, rows.iter().map(|r| r.1).sum::<f64>() / n);
        let sa = (rows.iter().map(|r| (r.0 - ma).powi(2)).sum::<f64>() / n).sqrt();
        let sb = (rows.iter().map(|r| (r.1 - mb).powi(2)).sum::<f64>() / n).sqrt();
        if sa < min_contrast || sb < min_contrast {
            return None;
        }
        let (mut h, mut g, mut square, mut product) = (Matrix2::zeros(), Vector2::zeros(), 0.0, 0.0);
        for (a, b, d) in &rows {
            let (a, b, d) = ((a - ma) / sa, (b - mb) / sb, d / sb);
            h += d * d.transpose();
            g += d * (a - b);
            square += (a - b) * (a - b);
            product += a * b;
        }
        let inverse = h.try_inverse()?;
        let step = inverse * g;
        last = Some((shift, inverse * (square / n), product / n));
        shift += step.map(|s| s.clamp(-1.0, 1.0));
        if shift.amax() > f64::from(REACH - 1) {
            return None;
        }
        if step.norm() < 0.02 {
            return last;
        }
    }
    last.filter(|(s, ..)| (s - shift).norm() < 0.1)
}

/// Dense matches of one part under a motion near the true one. `sdf` are the distance fields of both states, metres.
#[must_use]
pub fn texture_matches(
    surfaces: [&SurfaceSamples; 2],
    states: [&[RgbdFrame]; 2],
    sdf: [&Grid3<f32>; 2],
    motion: &Pose,
    noise: &NoiseConfig,
    config: &TextureConfig,
) -> Vec<MatchEvidence> {
    let gray = [GrayFrames::new(states[0], noise), GrayFrames::new(states[1], noise)];
    let mut all = Vec::new();
    for from in [0, 1] {
        let to = 1 - from;
        let warp = if from == 0 { *motion } else { motion.inverse() };
        let surface = surfaces[from];
        let stride = surface.points.len().div_ceil(config.points.max(1)).max(1);
        let picked: Vec<usize> = (0..surface.points.len()).step_by(stride).collect();
        let found: Vec<Option<(Point3<f64>, Point3<f64>, Matrix3<f64>, f64)>> = picked
            .par_iter()
            .map(|&i| match_point(&surface.points[i], &surface.normals[i], &warp, &gray[from], &gray[to], sdf[to], config))
            .collect();
        for (point, other, covariance, patch_area_m2) in found.into_iter().flatten() {
            // The covariance belongs to the far end; the near end is exact by definition.
            let (point0, point1) = if from == 0 { (point, other) } else { (other, point) };
            let (covariance0, covariance1) = if from == 0 { (Matrix3::zeros(), covariance) } else { (covariance, Matrix3::zeros()) };
            all.push((MatchEvidence { point0, point1, covariance0, covariance1, share: 1.0 }, patch_area_m2));
        }
    }
    share_out(all)
}

/// Overlapping patches share what they say: each counts as its share of the patches around it.
fn share_out(all: Vec<(MatchEvidence, f64)>) -> Vec<MatchEvidence> {
    let centers: Vec<Point3<f64>> = all.iter().map(|(m, _)| m.point0).collect();
    let shares: Vec<f64> = all
        .par_iter()
        .map(|(m, area)| 1.0 / centers.iter().filter(|c| (**c - m.point0).norm_squared() < area / 4.0).count().max(1) as f64)
        .collect();
    all.into_iter().zip(shares).map(|((m, _), share)| MatchEvidence { share, ..m }).collect()
}

/// Finds one surface point on the other state's surface: both points, covariance of the other, area of the patch.
fn match_point(
    point: &Point3<f64>,
    normal: &Vector3<f64>,
    warp: &Pose,
    from: &GrayFrames,
    to: &GrayFrames,
    sdf: &Grid3<f32>,
    config: &TextureConfig,
) -> Option<(Point3<f64>, Point3<f64>, Matrix3<f64>, f64)> {
    let warped = warp * point;
    let (distance, gradient) = sdf.sample_with_gradient(&warped);
    let other_normal = warp.rotation * normal;
    let gradient = gradient.cast::<f64>();
    if gradient.dot(&other_normal) < 0.7 * gradient.norm() {
        return None;
    }
    let center = warped - other_normal * f64::from(distance);
    let (frames, pixel_m) = from.best(point, normal, config.frames);
    let (other_frames, other_pixel_m) = to.best(&center, &other_normal, config.frames);
    if frames.is_empty() || other_frames.is_empty() {
        return None;
    }
    let helper = if normal.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let a = normal.cross(&helper).normalize();
    let axes = [a, normal.cross(&a)];
    let pixel_m = pixel_m.max(other_pixel_m);
    let spacing_m = config.spacing_pixels * pixel_m;
    let here = Tangent { center: *point, normal: *normal, axes, spacing_m };
    let there = Tangent { center, normal: other_normal, axes: axes.map(|a| warp.rotation * a), spacing_m };
    let reference = from.patch(&here, &frames, RADIUS);
    let target = to.patch(&there, &other_frames, RADIUS + REACH);
    let (shift, covariance, correlation) = align(&reference, &target, config.min_contrast)?;
    if correlation < config.min_correlation {
        return None;
    }
    let other = center + (there.axes[0] * shift.x + there.axes[1] * shift.y) * spacing_m;
    let floor = (config.pixel_sigma * pixel_m).powi(2);
    let mut spread = Matrix3::identity() * floor;
    for i in 0..2 {
        for j in 0..2 {
            spread += there.axes[i] * there.axes[j].transpose() * (covariance[(i, j)] * spacing_m * spacing_m);
        }
    }
    // Along the normal the distance fields speak; here it is left open.
    let open = (spacing_m * f64::from(RADIUS)).powi(2);
    spread += there.normal * there.normal.transpose() * open;
    let side = spacing_m * f64::from(2 * RADIUS + 1);
    Some((*point, other, spread, side * side))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texture(u: f64, v: f64) -> f32 {
        (0.5 + 0.2 * (0.55 * u + 0.2 * v).sin() + 0.2 * (0.5 * v - 0.3 * u + 1.0).cos()) as f32
    }

    fn patch(radius: i32, f: impl Fn(f64, f64) -> f32) -> Patch {
        let values =
            (-radius..=radius).flat_map(|v| (-radius..=radius).map(move |u| (u, v))).map(|(u, v)| f(f64::from(u), f64::from(v))).collect();
        Patch { radius, values }
    }

    #[test]
    fn a_shifted_and_dimmed_patch_is_found() {
        for (du, dv) in [(0.0, 0.0), (1.3, -0.7), (-2.2, 1.9)] {
            let reference = patch(RADIUS, texture);
            let target = patch(RADIUS + REACH, |u, v| 0.1 + 0.6 * texture(u - du, v - dv));
            let (shift, _, correlation) = align(&reference, &target, 0.01).unwrap();
            assert!((shift - Vector2::new(du, dv)).norm() < 0.1, "{shift}");
            assert!(correlation > 0.98);
        }
    }

    #[test]
    fn a_plain_patch_and_an_unseen_one_say_nothing() {
        let plain = patch(RADIUS + REACH, |_, _| 0.4);
        assert!(align(&patch(RADIUS, |_, _| 0.4), &plain, 0.01).is_none());
        let hidden = patch(RADIUS + REACH, |u, v| if u > 0.0 { f32::NAN } else { texture(u, v) });
        assert!(align(&patch(RADIUS, texture), &hidden, 0.01).is_none());
    }
}
