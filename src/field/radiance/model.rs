//! Queries of the trained fields and motions: densities, colors, meshes, joints.

use serde::{Deserialize, Serialize};

use super::HalfMotion;
use super::block::density_of_output;
use crate::{FieldParams, ObjectField};
use geometry::{Grid3, Pose, SceneBox};
use surface::{TriangleMesh, marching_cubes};

/// Density at the surface, per normalised unit. derived: the published one
const SURFACE_DENSITY: f64 = 10.0;
/// Half the side of the meshed cube, normalised units; limited by the fields' cube.
/// derived: the published one
const MESH_HALF_SIDE: f64 = 1.3;
/// Largest density in a grid, as marching cubes needs finite values. chosen: far above any surface
const DENSEST: f64 = 1e6;

/// Fields and half motions of all parts; part 0 is static.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RadianceModel {
    /// The normalised frame.
    pub scene: SceneBox,
    /// Half the side of every field's cube, normalised units.
    pub half_side: f64,
    /// One field per part.
    pub fields: Vec<FieldParams>,
    /// One half motion per mobile part: `motions[k - 1]` is that of part `k`.
    pub motions: Vec<HalfMotion>,
}

impl RadianceModel {
    /// `canonical_from_state0` of a part in the world frame, meters.
    pub fn canonical_from_state0(&self, part: usize) -> Pose {
        part.checked_sub(1).map_or_else(Pose::identity, |m| self.scene.world_motion(&self.motions[m].pose()))
    }

    /// `state1_from_state0` of parts 1 onward in the world frame, meters.
    pub fn motions_to_state1(&self) -> Vec<Pose> {
        self.motions.iter().map(|m| m.state1_from_state0(&self.scene)).collect()
    }

    /// The part's field for queries; its TSDF is the exponent of the density plus 1.
    fn part_field(&self, part: usize) -> ObjectField {
        let scene = SceneBox { center: self.scene.center, scale: self.scene.scale / self.half_side };
        ObjectField { params: self.fields[part].clone(), scene, truncation_m: 1.0, base: None }
    }

    /// Surface of a part in state 0, in the world frame, meters: marching cubes at density 10 per normalised
    /// unit, on `nodes` nodes per side (published: 256, for free motions 512) of a cube of 1.3 normalised
    /// units about the center. Vertices are colored as seen along the inward normal.
    ///
    /// # Panics
    /// If `nodes` is below 2 or the part does not exist.
    pub fn part_mesh(&self, part: usize, nodes: usize) -> TriangleMesh {
        let field = self.part_field(part);
        let half_side = MESH_HALF_SIDE.min(self.half_side);
        let cube = SceneBox { center: self.scene.center, scale: self.scene.scale / half_side };
        let mut grid = Grid3::over_scene(&cube, nodes, 0.0f32);
        // Layer by layer, to bound the memory for positions.
        for z in 0..nodes {
            let first = grid.index(0, 0, z);
            let points: Vec<_> = (first..first + nodes * nodes).map(|i| grid.position_of_index(i)).collect();
            for (value, out) in grid.values[first..].iter_mut().zip(field.signed_distances_m(&points)) {
                *value = (SURFACE_DENSITY - density_of_output(out).min(DENSEST)) as f32;
            }
        }
        let mut mesh = marching_cubes(&grid, 0.0);
        field.paint_mesh(&mut mesh);
        mesh.transformed(&self.canonical_from_state0(part).inverse())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FieldConfig;
    use nalgebra::Point3;
    use numeric::random::stage_rng;

    /// Every table and layer 0 but for what makes the density 1000 at high x of a one-level grid.
    fn half_space() -> FieldParams {
        let config = FieldConfig {
            levels: 1,
            base_resolution: 9,
            finest_resolution: 9,
            log2_table_size: 12,
            hidden: 4,
        };
        let mut p = FieldParams::random_params(&config, &mut stage_rng(0, "test/half_space", 0));
        let zeros = vec![0.0; p.parameter_count()];
        p.assign_values(&zeros);
        let n = p.levels[0].resolution;
        for i in 0..n * n * n {
            // Node x lies at unit (x - 0.5) / 8: the feature is the unit coordinate less a half.
            p.table[2 * i] = ((i % n) as f32 - 0.5) / 8.0 - 0.5;
        }
        // Exponent: 10 tanh-like by two units, x and -x, so that out = 40 (x - 0.5) + bias.
        let geometry = &mut p.geometry;
        geometry[0].weights[0] = 1.0;
        geometry[0].weights[2] = -1.0;
        geometry[1].weights[0] = 40.0;
        geometry[1].weights[1] = -40.0;
        geometry[1].biases[0] = 1.0 + 10f32.ln();
        p
    }

    #[test]
    fn the_surface_is_where_the_density_is_ten_and_moves_to_state_0() {
        let scene = SceneBox { center: Point3::new(0.1, 0.2, 0.3), scale: 2.0 };
        let half = HalfMotion::Free { pose: Pose::translation(0.2, 0.0, 0.0) };
        let model =
            RadianceModel { scene, half_side: 1.5, fields: vec![half_space(); 2], motions: vec![half] };
        let density = density_of_output(model.part_field(0).signed_distances_m(&[scene.center])[0]);
        assert!((density - 10.0).abs() < 1e-3, "{density}");
        let mean = |part: usize| {
            let mesh = model.part_mesh(part, 65);
            assert!(!mesh.is_empty() && mesh.colors.len() == mesh.vertices.len());
            assert!(mesh.colors.iter().flatten().all(|&c| c == 128), "no color: a half");
            mesh.vertices.iter().map(|v| f64::from(v.x)).sum::<f64>() / mesh.vertices.len() as f64
        };
        // The field's plane is the center's. A shift of 0.2 normalised units is 0.1 m.
        assert!((mean(0) - 0.1).abs() < 0.01, "{}", mean(0));
        assert!((mean(0) - mean(1) - 0.1).abs() < 1e-4);
    }
}
