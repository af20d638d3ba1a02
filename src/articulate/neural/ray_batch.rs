//! Samples near the observed surface of one state (docs/method.md 12.8).

use nalgebra::{Point3, Vector3};
use rand_core::Rng;
use rayon::prelude::*;

use crate::neural::{
    config::ArticulationConfig,
    state_model::{SurfaceRay, Volume},
};
use numeric::random::{index_below, unit_uniform};

/// Steepness of the near-surface weight, 1 / truncation distance.
/// derived: the published one, docs/method.md (12.15)
const STEEPNESS: f64 = 5.0;
/// Samples on every ray, stratified within one truncation distance of its depth.
pub(crate) const SAMPLES_PER_RAY: usize = 8;

/// Samples on some rays; all samples of a ray are adjacent.
pub(crate) struct RayBatch {
    /// Normalised positions.
    pub points: Vec<Point3<f64>>,
    /// Signed distance of the state itself at the samples, truncation distances.
    pub sdf: Vec<f64>,
    /// Near-surface weight of each sample, docs/method.md (12.15).
    pub weights: Vec<f64>,
    /// Whether the state saw each sample.
    pub visible: Vec<bool>,
    /// Unit world direction of every ray.
    pub directions: Vec<Vector3<f64>>,
    /// Index of one sample of every ray, drawn by weight: colors are compared there.
    pub colored: Vec<usize>,
}

impl RayBatch {
    /// Draws rays with replacement, and stratified samples within one truncation distance of their depth.
    pub(crate) fn draw(volume: &Volume<'_>, config: &ArticulationConfig, rng: &mut impl Rng) -> Self {
        let rays = volume.model.rays;
        let samples = SAMPLES_PER_RAY;
        // Random numbers are drawn sequentially; only the samples are computed in parallel.
        let chosen: Vec<SurfaceRay> = (0..config.rays).map(|_| rays[index_below(rng, rays.len())]).collect();
        let jitter: Vec<f64> = (0..config.rays * samples).map(|_| unit_uniform(rng)).collect();
        let picks: Vec<f64> = (0..config.rays).map(|_| unit_uniform(rng)).collect();
        let all: Vec<RaySample> = (0..chosen.len() * samples)
            .into_par_iter()
            .map(|i| {
                let ray = &chosen[i / samples];
                let share = ((i % samples) as f64 + jitter[i]) / samples as f64;
                ray_sample(ray, share, volume)
            })
            .collect();
        let weights: Vec<f64> = all.iter().map(|s| s.weight).collect();
        let colored = picks.iter().zip(weights.chunks_exact(samples)).enumerate();
        Self {
            points: all.iter().map(|s| s.point).collect(),
            sdf: all.iter().map(|s| s.sdf).collect(),
            visible: all.iter().map(|s| s.visible).collect(),
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
/// its depth.
fn ray_sample(ray: &SurfaceRay, share: f64, volume: &Volume<'_>) -> RaySample {
    let depth = ray.depth_m + (2.0 * share - 1.0) * volume.truncation_m;
    let point = volume.scene.normalise(&(ray.origin + ray.direction * depth));
    let sdf = volume.sdf(&point).0;
    // No field is defined outside the scene cube.
    let inside = point.coords.amax() <= 1.0;
    let weight = if inside { near_surface_weight(sdf) } else { 0.0 };
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

/// Weight of a sample from its signed distance in truncation distances: docs/method.md (12.15).
fn near_surface_weight(sdf: f64) -> f64 {
    if sdf.abs() >= 1.0 {
        return 0.0;
    }
    sigmoid(STEEPNESS * sdf) * sigmoid(-STEEPNESS * sdf)
}

fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_fall_from_the_surface_and_draw_samples() {
        assert_eq!(near_surface_weight(0.0), 0.25);
        assert_eq!(near_surface_weight(1.0), 0.0);
        assert!(near_surface_weight(-0.5) == near_surface_weight(0.5) && near_surface_weight(0.5) > 0.0);
        assert_eq!(draw_by_weight(&[0.0, 1.0, 3.0], 0.2), 1);
        assert_eq!(draw_by_weight(&[0.0, 1.0, 3.0], 0.3), 2);
    }
}
