//! Points for the occupancy and collision losses: uniform over the scene cube in expectation, drawn mostly
//! where one of the states is occupied.

use nalgebra::{Point3, Vector3};
use rand_core::Rng;
use rayon::prelude::*;

use crate::neural::{
    motion_params::{Motions, Way},
    state_model::Volume,
};
use geometry::Grid3;
use numeric::random::{below, unit};

/// Share of points that are drawn from the whole cube.
/// derived: the published one; it keeps every weight at 4 or less
const CUBE_SHARE: f64 = 0.25;
/// Share of points from the occupied voxels of each state.
/// derived: half of what the cube leaves
const STATE_SHARE: f64 = 0.375;

/// The voxels (cubes around grid nodes) of a state in which occupancy is not zero everywhere.
pub(crate) struct OccupiedVoxels {
    member: Vec<bool>,
    indices: Vec<u32>,
    /// Share of the scene cube.
    share: f64,
}

impl OccupiedVoxels {
    /// Finds the voxels; a signed distance changes by at most the distance to the node.
    pub(crate) fn of(volume: &Volume<'_>) -> Self {
        let grid = volume.model.sdf;
        // Half the ramp, and half the diagonal of a voxel.
        let reach = 0.5 * volume.ramp_m + 0.5 * 3.0f64.sqrt() * grid.spacing_m;
        let member: Vec<bool> = grid.values.iter().map(|d| f64::from(*d) < reach).collect();
        let indices: Vec<u32> = (0..member.len()).filter(|i| member[*i]).map(|i| i as u32).collect();
        let share = indices.len() as f64 * (grid.spacing_m / volume.scene.side_m()).powi(3);
        Self { member, indices, share }
    }

    fn contains(&self, volume: &Volume<'_>, point: &Point3<f64>) -> bool {
        volume.model.sdf.nearest(&volume.scene.world(point)).is_some_and(|i| self.member[i])
    }

    fn draw(&self, grid: &Grid3<f32>, volume: &Volume<'_>, rng: &mut impl Rng) -> Point3<f64> {
        let node = grid.position(self.indices[below(rng, self.indices.len())] as usize);
        let offset = Vector3::from_fn(|_, _| unit(rng) - 0.5) * grid.spacing_m;
        volume.scene.normalise(&(node + offset))
    }
}

/// Points of the scene cube with weights: the mean of a function over the cube is the mean of `weight *
/// f(point)`.
pub(crate) struct UniformBatch {
    /// Normalised positions, in the state that points are warped *out of*.
    pub points: Vec<Point3<f64>>,
    /// Ratio of uniform to proposal density.
    pub weights: Vec<f64>,
}

impl UniformBatch {
    /// Draws `count` points of the `here` state: a quarter uniform, the rest from its occupied voxels and
    /// from those of the `other` state moved here by a random part (`way` leads from `here` to `other`).
    /// Weights are those of the whole mixture.
    pub(crate) fn draw(
        count: usize,
        here: (&Volume<'_>, &OccupiedVoxels),
        other: (&Volume<'_>, &OccupiedVoxels),
        (motions, way): (&Motions, Way),
        rng: &mut impl Rng,
    ) -> Self {
        let parts = motions.parts.len();
        // Most of the cube is empty.
        let shares = [
            CUBE_SHARE,
            if here.1.indices.is_empty() { 0.0 } else { STATE_SHARE },
            if other.1.indices.is_empty() { 0.0 } else { STATE_SHARE },
        ];
        let total: f64 = shares.iter().sum();
        let draw = |_| {
            // Without voxels of a state, its share goes to the others.
            let pick = unit(rng) * total;
            if pick < shares[0] {
                Point3::from(Vector3::from_fn(|_, _| 2.0 * unit(rng) - 1.0))
            } else if pick < shares[0] + shares[1] {
                here.1.draw(here.0.model.sdf, here.0, rng)
            } else {
                let part = below(rng, parts);
                motions.apply(part, way.reverse(), &other.1.draw(other.0.model.sdf, other.0, rng))
            }
        };
        let points: Vec<Point3<f64>> = (0..count).map(draw).collect();
        let weight = |x: &Point3<f64>| {
            // A part took it out of the cube, where the uniform density is 0.
            if x.coords.amax() > 1.0 {
                return 0.0;
            }
            let mut density = shares[0];
            if here.1.contains(here.0, x) {
                density += shares[1] / here.1.share;
            }
            // A point may have come from any part that leads to an occupied voxel.
            let reached =
                (0..parts).filter(|i| other.1.contains(other.0, &motions.apply(*i, way, x))).count();
            density += shares[2] * reached as f64 / parts as f64 / other.1.share.max(1e-300);
            total / density
        };
        let weights = points.par_iter().map(weight).collect();
        Self { points, weights }
    }
}
