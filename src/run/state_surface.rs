//! The surface of one state: field, mesh, distance field, visibility, points.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::RunError;
use crate::{
    articulate::{SurfaceSamples, mesh_samples},
    capture::{NoiseConfig, RgbdFrame, median_over_object, pixel_weights},
    field::ObjectField,
    geometry::{Grid3, SceneBox},
    surface::{
        DistanceOptions, FreeSpaceRule, SurfaceConfig, TriangleMesh, TsdfVolume, free_space_grid,
        keep_components, marching_cubes, object_roles, object_views, signed_distance, visibility_grid,
    },
};

/// What one state's recording says about scale and noise.
#[derive(Clone, Copy, Debug)]
pub struct Band {
    /// Truncation distance, meters.
    pub truncation_m: f64,
    /// Observation weight from which a node counts.
    pub min_weight: f32,
}

impl Band {
    /// From the median depth of the object's pixels in all states.
    #[must_use]
    pub fn of(
        states: &[&[RgbdFrame]],
        scene: &SceneBox,
        noise: &NoiseConfig,
        config: &SurfaceConfig,
    ) -> Self {
        let all = || states.iter().copied().flatten();
        let sigma_m = median_over_object(all(), |f, i| f.sigma_m(i, noise)).unwrap_or(1.0);
        let depth_m = median_over_object(all(), |f, i| f64::from(f.depth_m[i])).unwrap_or(1.0);
        let one_reading_m = noise.sigma_m(depth_m);
        let asked_m = config.truncation_m.or(config.truncation_normalized.map(|t| t / scene.scale));
        Self {
            // docs/method.md (3.1).
            truncation_m: asked_m.unwrap_or_else(|| (0.02 * scene.extent_m()).max(4.0 * sigma_m)),
            // A reading's weight is relative to one at 1 m (3.2), and the object is farther or nearer.
            min_weight: (config.min_readings * (noise.sigma_m(1.0) / one_reading_m).powi(2)) as f32,
        }
    }
}

/// Everything later stages need of one state.
#[derive(Serialize, Deserialize)]
pub struct StateSurface {
    /// Truncated signed distance, meters, NaN where unobserved.
    pub tsdf: Grid3<f32>,
    /// Observation weight at the same nodes.
    pub weight: Grid3<f32>,
    /// Whole surface, colored.
    pub mesh: TriangleMesh,
    /// Untruncated signed distance, meters.
    pub sdf: Grid3<f32>,
    /// Nodes that some view sees (same nodes as `sdf`).
    pub visible: Grid3<bool>,
    /// Nodes that are certainly empty (same nodes as `sdf`).
    pub free: Grid3<bool>,
    /// Points on the surface.
    pub samples: SurfaceSamples,
}

/// Fuses the frames of one state into a truncated distance volume.
#[must_use]
pub fn fuse(
    frames: &[RgbdFrame],
    scene: &SceneBox,
    band: &Band,
    noise: &NoiseConfig,
    nodes: usize,
) -> TsdfVolume {
    let grid = Grid3::over(scene, nodes, ());
    let mut volume = TsdfVolume::new(grid.origin, grid.spacing_m, grid.dims, band.truncation_m);
    // The frames in parallel, the sum in their order: the bytes do not depend on the number of threads.
    let weights: Vec<Vec<f32>> = frames.par_iter().map(|frame| pixel_weights(frame, noise)).collect();
    let roles: Vec<_> =
        frames.par_iter().zip(&weights).map(|(frame, weights)| object_roles(frame, weights)).collect();
    let views = object_views(frames, &weights, &roles);
    views.iter().for_each(|view| volume.integrate(view, noise));
    // Once more near the surface, by the views that see a node's side (3.4): those of the other
    // side of a thin panel would push it outwards.
    volume.face(&views, noise);
    volume
}

/// The surface of one state from its fused volume and its field (`None`: fusion alone).
///
/// # Errors
/// A state without a surface.
pub fn state_surface(
    frames: &[RgbdFrame],
    volume: &TsdfVolume,
    field: Option<&ObjectField>,
    scene: &SceneBox,
    band: &Band,
    noise: &NoiseConfig,
    config: &SurfaceConfig,
) -> Result<StateSurface, RunError> {
    let failed = |e| RunError::stage("surface", e);
    let mut tsdf = volume.tsdf(band.min_weight);
    // Distances, visibility and free space on one grid (docs/method.md 3.4, 3.5).
    let nodes = Grid3::over(scene, config.distance_nodes, ());
    let free = free_space_grid(frames, &nodes, &FreeSpaceRule { noise: *noise, ..FreeSpaceRule::default() });
    if let Some(field) = field {
        blend_in_field(&mut tsdf, volume.weights(), field, band.min_weight, &free);
    }
    let weight = Grid3 {
        origin: tsdf.origin,
        spacing_m: tsdf.spacing_m,
        dims: tsdf.dims,
        values: volume.weights().to_vec(),
    };
    let mut mesh = keep_components(&marching_cubes(&tsdf, 0.0), config.min_component);
    match field {
        Some(field) => field.paint(&mut mesh),
        None => volume.paint(&mut mesh),
    }
    let visible = visibility_grid(frames, &nodes, band.truncation_m);
    // What was seen empty is outside, whatever an open mesh says.
    let sdf = signed_distance(&mesh, &nodes, Some(&free), &DistanceOptions::default()).map_err(failed)?;
    let samples = mesh_samples(&mesh, config.points);
    Ok(StateSurface { tsdf, weight, mesh, sdf, visible, free, samples })
}

/// Takes the field's distances at all observed nodes near a fused surface, but where views saw that nothing
/// is; elsewhere the fused free space stands. A field that is a residual counts as much as the least weight
/// with which a node is observed (docs/method.md 12.5): it is a guess by its neighborhood, which readings
/// outvote.
fn blend_in_field(
    tsdf: &mut Grid3<f32>,
    weights: &[f32],
    field: &ObjectField,
    min_weight: f32,
    free: &Grid3<bool>,
) {
    let limit = field.truncation_m as f32;
    let near: Vec<usize> = (0..tsdf.values.len()).filter(|&i| tsdf.values[i].abs() < 0.999 * limit).collect();
    let points: Vec<_> = near.iter().map(|&i| tsdf.position(i)).collect();
    for ((i, p), d) in near.into_iter().zip(&points).zip(field.tsdf(&points)) {
        let share = if field.base.is_some() { min_weight / (min_weight + weights[i]) } else { 1.0 };
        let is_carved = d < 0.0 && free.nearest(p).is_some_and(|n| free.values[n]);
        let d = if is_carved { limit } else { d };
        tsdf.values[i] += share * (d.clamp(-limit, limit) - tsdf.values[i]);
    }
}
