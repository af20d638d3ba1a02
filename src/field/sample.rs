//! The samples of an optimiser step, determined by seed and step (docs/method.md 12.3).

use nalgebra::Point3;
use rayon::prelude::*;

use super::config::NON_NEGATIVE_WEIGHT;
use super::engine::BACKGROUND_TSDF;
use super::fused::sees_side;
use super::pool::{FAR_M, NEAR_M, RayPool, SurfaceRay};
use super::{BackgroundLoss, Occupancy, SampleBatch, SdfTarget, TrainConfig};
use geometry::{Grid3, SceneBox};
use numeric::random::{STREAM_STEP, split_mix, unit_of};

/// Share of background rays (past the object), if there are any.
/// chosen: enough for the outline, most rays for the surface
const BACKGROUND_SHARE: f64 = 0.2;
/// Weight of the color loss.
/// derived: the published one
const COLOR_WEIGHT: f32 = 10.0;
/// Sharpness `a` of the color weights along a ray: `sigmoid(a q) sigmoid(-a q)`, q in truncations.
/// derived: the published one
const COLOR_SHARPNESS: f64 = 5.0;
/// Rays drawn per task.
const RAYS_PER_TASK: usize = 256;

/// Input for drawing samples.
pub(super) struct Sampler<'a> {
    pub pool: &'a RayPool,
    pub scene: &'a SceneBox,
    pub occupancy: &'a Occupancy,
    pub config: &'a TrainConfig,
    pub truncation_m: f64,
    /// Trust in every surface ray, 0 to 255.
    pub trust: &'a [u8],
    /// Fused distances, meters, if rays supervise only their side of them.
    pub sides: Option<&'a Grid3<f32>>,
    /// Base of the network's output, in truncations, if it is a residual.
    pub base: Option<&'a Grid3<f32>>,
}

/// A counter-based stream of uniform numbers in `[0, 1)`, one per ray, so that rays can be drawn in any
/// order.
pub(super) struct Stream(pub u64);

impl Stream {
    pub(crate) fn next(&mut self) -> f64 {
        let bits = split_mix(self.0);
        self.0 = self.0.wrapping_add(STREAM_STEP);
        unit_of(bits)
    }
}

/// Part of a batch written by one ray.
struct RaySlot<'a> {
    points: &'a mut [[f32; 3]],
    targets: &'a mut [SdfTarget],
    color_weights: &'a mut [f32],
    direction: &'a mut [f32; 3],
    color: &'a mut [f32; 3],
    ray_weight: &'a mut f32,
}

impl Sampler<'_> {
    /// The batch of a step with the random key `key`. Rays are stratified: the k-th of n comes from the k-th
    /// n-th of the pool, so every batch covers all views and image regions.
    pub(crate) fn step_batch(&self, key: u64) -> SampleBatch {
        let c = self.config;
        let rays = c.rays;
        let per_ray = c.free_samples + c.band_samples;
        let with_background = c.background != BackgroundLoss::Off && !self.pool.background.is_empty();
        let background = if with_background { (BACKGROUND_SHARE * rays as f64).round() as usize } else { 0 };
        let mut b = SampleBatch {
            rays,
            samples_per_ray: per_ray,
            points: vec![[0.5; 3]; rays * per_ray],
            targets: vec![SdfTarget::Ignore; rays * per_ray],
            color_weights: vec![0.0; rays * per_ray],
            directions: vec![[0.0, 0.0, 1.0]; rays],
            colors: vec![[0.0; 3]; rays],
            ray_weights: vec![0.0; rays],
        };
        let slots = b.points.par_chunks_exact_mut(per_ray).zip(b.targets.par_chunks_exact_mut(per_ray));
        let slots = slots.zip(b.color_weights.par_chunks_exact_mut(per_ray)).zip(&mut b.directions);
        let slots = slots.zip(&mut b.colors).zip(&mut b.ray_weights).enumerate().with_min_len(RAYS_PER_TASK);
        let surface = rays - background;
        slots.for_each_init(
            Vec::new,
            |intervals, (ray, (((((points, targets), color_weights), direction), color), ray_weight))| {
                let slot = RaySlot { points, targets, color_weights, direction, color, ray_weight };
                // Streams have 2^32 numbers each, so those of two rays never overlap.
                let mut stream = Stream(key.wrapping_add((ray as u64) << 32));
                if ray < surface {
                    let index = stratified_index(ray, surface, self.pool.surface.len(), stream.next());
                    self.surface_ray(index, &mut stream, intervals, slot);
                } else {
                    let k = ray - surface;
                    let index = stratified_index(k, background, self.pool.background.len(), stream.next());
                    self.background_ray(index, &mut stream, intervals, slot);
                }
            },
        );
        b
    }

    /// Free samples in front of the surface, band samples around it.
    fn surface_ray(
        &self,
        index: usize,
        stream: &mut Stream,
        intervals: &mut Vec<(f64, f64)>,
        slot: RaySlot<'_>,
    ) {
        let c = self.config;
        let ray = self.pool.surface[index];
        let (origin, direction) = self.pool.views[usize::from(ray.frame)].pixel_ray(ray.pixel);
        let tau = self.truncation_m;
        let depth = f64::from(ray.depth_m);
        let length = direction.norm();
        let weight = self.surface_weight(&ray, self.trust[index]);
        // Signed distance, in truncations, per meter of z-depth.
        // docs/method.md (12.3).
        let per_depth = length / tau;
        // Range of z-depth, meters, over which the signed distance spans the truncation.
        let band = 1.0 / per_depth;
        self.occupancy.occupied_intervals(&origin, &direction, NEAR_M, depth - band, intervals);
        // Always drawn, so that the share does not change the samples.
        let colored = stream.next() < c.color_share;
        let mut bell = 0.0;
        for i in 0..c.free_samples + c.band_samples {
            let free = i < c.free_samples;
            let z = if free {
                match stratified_place(intervals, (i as f64 + stream.next()) / c.free_samples as f64) {
                    Some(z) => z,
                    None => continue,
                }
            } else {
                depth
                    + band
                        * (2.0 * ((i - c.free_samples) as f64 + stream.next()) / c.band_samples as f64 - 1.0)
            };
            let place = origin + direction * z;
            slot.points[i] = self.unit_coordinates(&place);
            let value = (depth - z) * per_depth;
            let base = self.base_at(&place);
            if free {
                slot.targets[i] = SdfTarget::Empty { value: 1.0 - base, weight: c.empty_weight as f32 };
                continue;
            }
            // Depth behind the surface is weaker evidence, since that space is hidden.
            let falloff = if c.behind_falloff { (1.0 + value).clamp(0.0, 1.0) } else { 1.0 };
            if self.sides.is_none_or(|sides| sees_side(sides, tau, &place, &origin)) {
                let value = value as f32 - base;
                slot.targets[i] = SdfTarget::Surface { value, weight: weight * falloff as f32 };
            }
            // docs/method.md (12.8): the derivative of a logistic function, a bell about the surface.
            let e = (-COLOR_SHARPNESS * value).exp();
            slot.color_weights[i] = if colored { (e / ((1.0 + e) * (1.0 + e))) as f32 } else { 0.0 };
            bell += slot.color_weights[i];
        }
        // The weights of a ray sum to 1, as in the volume rendering of an opaque surface.
        if colored && bell > 0.0 {
            slot.color_weights.iter_mut().for_each(|w| *w /= bell);
            *slot.ray_weight = COLOR_WEIGHT * f32::from(self.trust[index]) / 255.0;
        }
        *slot.color = ray.rgb.map(|v| f32::from(v) / 255.0);
        *slot.direction = (direction / length).map(|x| x as f32).into();
    }

    /// All samples lie in occupied cells in front of the depth that the pixel shows.
    fn background_ray(
        &self,
        index: usize,
        stream: &mut Stream,
        intervals: &mut Vec<(f64, f64)>,
        slot: RaySlot<'_>,
    ) {
        let ray = self.pool.background[index];
        let (origin, direction) = self.pool.views[usize::from(ray.frame)].pixel_ray(ray.pixel);
        let to = if ray.depth_m > 0.0 { f64::from(ray.depth_m) - self.truncation_m } else { FAR_M };
        self.occupancy.occupied_intervals(&origin, &direction, NEAR_M, to, intervals);
        let n = slot.points.len();
        for i in 0..n {
            if let Some(z) = stratified_place(intervals, (i as f64 + stream.next()) / n as f64) {
                let place = origin + direction * z;
                slot.points[i] = self.unit_coordinates(&place);
                slot.targets[i] = self.background_target(self.base_at(&place));
            }
        }
        *slot.direction = direction.normalize().map(|x| x as f32).into();
    }

    /// Target on a background ray; `base` is the base of the network's output.
    fn background_target(&self, base: f32) -> SdfTarget {
        match self.config.background {
            BackgroundLoss::Off => SdfTarget::Ignore,
            BackgroundLoss::Empty => {
                SdfTarget::Empty { value: 1.0 - base, weight: self.config.empty_weight as f32 }
            }
            BackgroundLoss::NonNegative => {
                SdfTarget::Background { value: BACKGROUND_TSDF - base, weight: NON_NEGATIVE_WEIGHT as f32 }
            }
        }
    }

    /// Weight of a ray's surface loss: the configured one, times `2 cos / (1 + (sigma / median)^2)` for the
    /// expected noise, times the trust in the ray.
    fn surface_weight(&self, ray: &SurfaceRay, trust: u8) -> f32 {
        // docs/method.md (12.5).
        let mut weight = self.config.surface_weight * f64::from(trust) / 255.0;
        if self.config.noise_weights {
            let ratio = f64::from(ray.sigma_m) / self.pool.median_sigma_m;
            weight *= 2.0 * f64::from(ray.cosine) / (1.0 + ratio * ratio);
        }
        weight as f32
    }

    /// Base of the network's output at a point, in truncations.
    fn base_at(&self, place: &Point3<f64>) -> f32 {
        self.base.map_or(0.0, |base| base.value_at(place))
    }

    /// Unit-cube coordinates of a point.
    fn unit_coordinates(&self, place: &Point3<f64>) -> [f32; 3] {
        let n = self.scene.normalise(place);
        [n.x, n.y, n.z].map(|x| (0.5 * (x + 1.0)) as f32)
    }
}

/// Index into a pool: a random one, by `u` in `[0, 1)`, of its `k`-th of `of` equal parts.
fn stratified_index(k: usize, of: usize, pool: usize, u: f64) -> usize {
    (((k as f64 + u) / of as f64 * pool as f64) as usize).min(pool - 1)
}

/// The point at fraction `u` of the joined intervals; `None` without any.
fn stratified_place(intervals: &[(f64, f64)], u: f64) -> Option<f64> {
    let total: f64 = intervals.iter().map(|i| i.1 - i.0).sum();
    let mut rest = u * total;
    for &(from, to) in intervals {
        if rest <= to - from {
            return Some(from + rest);
        }
        rest -= to - from;
    }
    intervals.last().map(|i| i.1)
}
