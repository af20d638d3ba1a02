//! Samples near the observed surface of one state (docs/method.md 12.8).

use nalgebra::{Point3, Vector3};
use rand_core::Rng;
use rayon::prelude::*;

use crate::neural::{
    config::{ArticulationConfig, MethodVersion},
    state_model::{SurfaceRay, Volume},
};
use numeric::random::{index_below, unit_uniform};

/// Steepness of the near-surface weight, 1 / truncation distance.
/// derived: the published one, docs/method.md (12.15)
const STEEPNESS: f64 = 5.0;
/// Signed distance from which the released program gives no weight, truncation distances.
/// derived: docs/method.md 12.9
const RELEASED_CUT: f64 = 0.05;
/// Number by which the released program divides the distance.
/// derived: docs/method.md 12.9
const RELEASED_SCALE: f64 = 0.03;

/// Samples on some rays; all samples of a ray are adjacent.
pub(crate) struct RayBatch {
    /// Samples on every ray.
    pub samples_per_ray: usize,
    /// Normalised positions.
    pub points: Vec<Point3<f64>>,
    /// Signed distance of the state itself at the samples, truncation distances.
    pub sdf: Vec<f64>,
    /// Near-surface weight of each sample, docs/method.md (12.15), times the weight of its ray.
    pub weights: Vec<f64>,
    /// Whether the state saw each sample.
    pub visible: Vec<bool>,
    /// Expected standard deviation of every ray's depth, truncation distances.
    pub sigma: Vec<f64>,
    /// Unit world direction of every ray.
    pub directions: Vec<Vector3<f64>>,
    /// Index of one sample of every ray, drawn by weight: colors are compared there.
    pub colored: Vec<usize>,
}

impl RayBatch {
    /// Draws rays with replacement, and stratified samples within one truncation distance of their depth.
    /// `typical_sigma_m` is the depth noise of a ray of weight 1.
    pub(crate) fn draw(
        volume: &Volume<'_>,
        config: &ArticulationConfig,
        typical_sigma_m: f64,
        rng: &mut impl Rng,
    ) -> Self {
        let rays = volume.model.rays;
        let samples = config.samples_per_ray;
        // Random numbers are drawn sequentially; only the samples are computed in parallel.
        let chosen: Vec<SurfaceRay> = (0..config.rays).map(|_| rays[index_below(rng, rays.len())]).collect();
        let jitter: Vec<f64> = (0..config.rays * samples).map(|_| unit_uniform(rng)).collect();
        let picks: Vec<f64> = (0..config.rays).map(|_| unit_uniform(rng)).collect();
        let all: Vec<RaySample> = (0..chosen.len() * samples)
            .into_par_iter()
            .map(|i| {
                let ray = &chosen[i / samples];
                let trust = if config.noise_weights { typical_sigma_m / ray.sigma_m } else { 1.0 };
                let share = ((i % samples) as f64 + jitter[i]) / samples as f64;
                ray_sample(ray, share, trust, volume, config.compatibility.near_surface_weight)
            })
            .collect();
        let weights: Vec<f64> = all.iter().map(|s| s.weight).collect();
        let colored = picks.iter().zip(weights.chunks_exact(samples)).enumerate();
        Self {
            samples_per_ray: samples,
            points: all.iter().map(|s| s.point).collect(),
            sdf: all.iter().map(|s| s.sdf).collect(),
            visible: all.iter().map(|s| s.visible).collect(),
            sigma: chosen.iter().map(|r| r.sigma_m / volume.truncation_m).collect(),
            directions: chosen.iter().map(|r| r.direction.normalize()).collect(),
            colored: colored.map(|(ray, (pick, w))| ray * samples + draw_by_weight(w, *pick)).collect(),
            weights,
        }
    }
}

/// One sample of a ray: see [`RayBatch`].
struct RaySample {
    point: Point3<f64>,
    sdf: f64,
    weight: f64,
    visible: bool,
}

/// The sample of a ray at a `share`, in `[0, 1)`, of the interval of one truncation distance either side of
/// its depth; `trust` is the weight of the ray.
fn ray_sample(
    ray: &SurfaceRay,
    share: f64,
    trust: f64,
    volume: &Volume<'_>,
    version: MethodVersion,
) -> RaySample {
    let depth = ray.depth_m + (2.0 * share - 1.0) * volume.truncation_m;
    let point = volume.scene.normalise(&(ray.origin + ray.direction * depth));
    let sdf = volume.sdf(&point).0;
    // No field is defined outside the scene cube.
    let inside = point.coords.amax() <= 1.0;
    let weight = if inside { trust * near_surface_weight(sdf, version) } else { 0.0 };
    RaySample { point, sdf, weight, visible: volume.is_visible(&point) }
}

/// Selects an index in proportion to the weights with a uniform number in `[0, 1)`.
fn draw_by_weight(weights: &[f64], pick: f64) -> usize {
    let mut left = pick * weights.iter().sum::<f64>();
    for (i, w) in weights.iter().enumerate() {
        left -= w;
        if left < 0.0 {
            return i;
        }
    }
    // Rounding may leave a remainder, and all weights may be 0.
    weights.len() - 1
}

/// Weight of a sample from its signed distance in truncation distances (docs/method.md 12.8;
/// docs/method.md 12.9 for the released one).
fn near_surface_weight(sdf: f64, version: MethodVersion) -> f64 {
    let q = match version {
        MethodVersion::Paper if sdf.abs() < 1.0 => sdf,
        MethodVersion::Released if sdf < RELEASED_CUT => (sdf / RELEASED_SCALE).max(-0.5),
        _ => return 0.0,
    };
    // docs/method.md (12.15).
    sigmoid(STEEPNESS * q) * sigmoid(-STEEPNESS * q)
}

fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_readings_of_the_weight_are_as_described() {
        assert_eq!(near_surface_weight(0.0, MethodVersion::Paper), 0.25);
        assert_eq!(near_surface_weight(1.0, MethodVersion::Paper), 0.0);
        assert!((near_surface_weight(-0.9, MethodVersion::Released) - 0.070).abs() < 1e-3);
        assert_eq!(near_surface_weight(0.05, MethodVersion::Released), 0.0);
        assert_eq!(draw_by_weight(&[0.0, 1.0, 3.0], 0.2), 1);
        assert_eq!(draw_by_weight(&[0.0, 1.0, 3.0], 0.3), 2);
    }
}
