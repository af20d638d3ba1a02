//! The surface of one state: field, mesh, distance field, visibility, points.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use tracing::debug;

use super::{RunError, scene::Scene};
use articulate::{SurfaceSamples, mesh_samples};
use capture::{RgbdFrame, Unread};
use field::ObjectField;
use geometry::Grid3;
use surface::{
    DistanceOptions, FreeSpaceRule, TriangleMesh, TsdfView, TsdfVolume, at_least, keep_components,
    marching_cubes, signed_distance, views_through, visibility_grid,
};

/// Nodes look for the nearest surface up to this share of the object's extent: joint estimation needs no
/// more.
/// chosen: more than the reach of joints' evidence, 0.03, and the diagonal of a cell of 0.006
const NEAR: f64 = 0.05;

/// A place inside a surface is a stray if one view of this many sees through it.
/// measured: two views of 30 opened holes in the faces of a cabinet in matched depth
const SEEN_THROUGH: usize = 4;

/// Everything later stages need of one state.
#[derive(Serialize, Deserialize)]
pub(crate) struct StateSurface {
    /// Truncated signed distance, meters, NaN where unobserved.
    pub tsdf: Grid3<f32>,
    /// Observation weight at the same nodes.
    pub weight: Grid3<f32>,
    /// Whole surface, colored.
    pub mesh: TriangleMesh,
    /// Untruncated signed distance, meters.
    pub sdf: Grid3<f32>,
    /// Whether some view saw each node (same nodes as `sdf`).
    pub visible: Grid3<bool>,
    /// Whether each node is certainly empty (same nodes as `sdf`).
    pub free: Grid3<bool>,
    /// Points on the surface.
    pub samples: SurfaceSamples,
}

/// Fuses the frames of one state into a truncated distance volume.
pub(super) fn fuse(frames: &[RgbdFrame], scene: &Scene) -> TsdfVolume {
    let grid = Grid3::over_scene(&scene.bounds, scene.config.surface.nodes, ());
    let mut volume = TsdfVolume::new(grid.origin, grid.spacing_m, grid.dims, scene.band.truncation_m);
    let views: Vec<TsdfView> =
        frames.par_iter().map(|f| TsdfView::of_object(f, scene.unread, &scene.noise)).collect();
    volume.fuse(&views);
    volume
}

/// The surface of one state from its fused volume and its field (`None`: from fusion alone).
///
/// # Errors
/// A state without a surface.
pub(super) fn state_surface(
    frames: &[RgbdFrame],
    volume: &TsdfVolume,
    field: Option<&ObjectField>,
    scene: &Scene,
) -> Result<StateSurface, RunError> {
    let Scene { bounds, band, noise, config, .. } = scene;
    let surface = &config.surface;
    let failed = |e| RunError::stage("surface", e);
    let mut tsdf = volume.distance_grid(band.min_weight);
    // Distances, visibility and free space on one grid (docs/method.md 3.4, 3.5).
    let nodes = Grid3::over_scene(bounds, surface.distance_nodes, ());
    let rule = FreeSpaceRule {
        noise: *noise,
        shared_error: scene.shared_error,
        unread: scene.unread,
        ..FreeSpaceRule::default()
    };
    let is_masked = scene.unread == Unread::Empty;
    let many = (frames.len() / SEEN_THROUGH).clamp(usize::from(rule.min_views), usize::from(u8::MAX)) as u8;
    let through = views_through(frames, &nodes, &rule, if is_masked { rule.min_views } else { many });
    let free = at_least(&through, rule.min_views);
    if let Some(field) = field {
        blend_in_field(&mut tsdf, volume.weights(), field, band.min_weight, &free);
    }
    // A recorded mask leaves stray readings at outlines out.
    if !is_masked {
        carve(&mut tsdf, &at_least(&through, many), band.truncation_m as f32);
    }
    let weight = Grid3 {
        origin: tsdf.origin,
        spacing_m: tsdf.spacing_m,
        dims: tsdf.dims,
        values: volume.weights().to_vec(),
    };
    let mut mesh = keep_components(&marching_cubes(&tsdf, 0.0), surface.min_component);
    match field {
        Some(field) => field.paint_mesh(&mut mesh),
        None => volume.paint_vertices(&mut mesh),
    }
    debug!(
        observed_nodes = tsdf.values.iter().filter(|d| !d.is_nan()).count(),
        spacing_m = tsdf.spacing_m,
        truncation_m = band.truncation_m,
        min_weight = band.min_weight,
        triangles = mesh.triangles.len(),
        "surface of a state fused"
    );
    let visible = visibility_grid(frames, &nodes, band.truncation_m);
    // Places seen empty are outside, even where an open mesh encloses them.
    // Fields are compared everywhere.
    let near_m = if config.trains_fields() { f64::INFINITY } else { NEAR * bounds.extent_m() };
    let options = DistanceOptions { near_m, ..DistanceOptions::default() };
    let sdf = signed_distance(&mesh, &nodes, Some(&free), &options).map_err(failed)?;
    let samples = mesh_samples(&mesh, surface.points);
    Ok(StateSurface { tsdf, weight, mesh, sdf, visible, free, samples })
}

/// Opens places inside a surface that views saw empty (docs/method.md 3.5): stray readings at the outlines of
/// things.
fn carve(tsdf: &mut Grid3<f32>, free: &Grid3<bool>, truncation_m: f32) {
    let inside: Vec<usize> = (0..tsdf.values.len()).filter(|&i| tsdf.values[i] < 0.0).collect();
    let is_empty = |i: &usize| free.nearest_node(&tsdf.position_of_index(*i)).is_some_and(|n| free.values[n]);
    let empty: Vec<usize> = inside.into_par_iter().filter(is_empty).collect();
    for i in empty {
        tsdf.values[i] = truncation_m;
    }
}

/// Replaces fused distances by the field's at all observed nodes near a fused surface, except where views saw
/// free space. The field's residual counts as much as the least weight of an observed node
/// (docs/method.md 12.5): it is a guess from the neighborhood, which readings outvote.
fn blend_in_field(
    tsdf: &mut Grid3<f32>,
    weights: &[f32],
    field: &ObjectField,
    min_weight: f32,
    free: &Grid3<bool>,
) {
    let limit = field.truncation_m as f32;
    let near: Vec<usize> = (0..tsdf.values.len()).filter(|&i| tsdf.values[i].abs() < 0.999 * limit).collect();
    let points: Vec<_> = near.iter().map(|&i| tsdf.position_of_index(i)).collect();
    for ((i, p), d) in near.into_iter().zip(&points).zip(field.signed_distances_m(&points)) {
        let share = if field.base.is_some() { min_weight / (min_weight + weights[i]) } else { 1.0 };
        let is_carved = d < 0.0 && free.nearest_node(p).is_some_and(|n| free.values[n]);
        let d = if is_carved { limit } else { d };
        tsdf.values[i] += share * (d.clamp(-limit, limit) - tsdf.values[i]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::SceneBox;
    use nalgebra::Point3;

    #[test]
    fn only_what_lies_inside_a_surface_and_was_seen_empty_is_opened() {
        let scene = SceneBox::around_box(&Point3::new(-1.0, -1.0, -1.0), &Point3::new(1.0, 1.0, 1.0));
        let mut tsdf = Grid3::over_scene(&scene, 11, -0.5f32);
        tsdf.values[0] = f32::NAN;
        tsdf.values[1] = 0.25;
        let mut free = Grid3::over_scene(&scene, 11, false);
        free.values[..3].fill(true);
        carve(&mut tsdf, &free, 0.75);
        assert!(tsdf.values[0].is_nan());
        assert_eq!(tsdf.values[1..4], [0.25, 0.75, -0.5]);
    }
}
