//! Points for the occupancy and collision losses: with their weights they are uniform over the scene cube,
//! but most are drawn where one of the states is occupied.

use nalgebra::{Point3, Vector3};
use rand_core::Rng;
use rayon::prelude::*;

use crate::neural::{
    motion_params::{Motions, Way},
    state_model::Volume,
};
use numeric::random::{index_below, unit_uniform};

/// Share of points drawn from the whole cube.
/// derived: the published one; it keeps every weight at 4 or less
const CUBE_SHARE: f64 = 0.25;
/// Share of points drawn from the occupied voxels of each state.
/// derived: half of the rest beside the cube
const STATE_SHARE: f64 = 0.375;

/// The voxels (cubes around grid nodes) of a state that contain occupied space.
pub(crate) struct OccupiedVoxels {
    member: Vec<bool>,
    indices: Vec<u32>,
    /// Share of the scene cube that they fill.
    share: f64,
}

impl OccupiedVoxels {
    /// Finds the voxels: the signed distance differs from a node's by at most the distance to the node.
    pub(crate) fn of(volume: &Volume<'_>) -> Self {
        let grid = volume.model.sdf;
        // Half the ramp plus half the diagonal of a voxel.
        let reach = 0.5 * volume.ramp_m + 0.5 * 3.0f64.sqrt() * grid.spacing_m;
        let member: Vec<bool> = grid.values.iter().map(|d| f64::from(*d) < reach).collect();
        let indices: Vec<u32> = (0..member.len()).filter(|i| member[*i]).map(|i| i as u32).collect();
        let share = indices.len() as f64 * (grid.spacing_m / volume.scene.side_m()).powi(3);
        Self { member, indices, share }
    }
}

/// A state with its occupied voxels.
#[derive(Clone, Copy)]
pub(crate) struct OccupiedState<'a> {
    pub volume: &'a Volume<'a>,
    pub voxels: &'a OccupiedVoxels,
}

impl OccupiedState<'_> {
    fn contains(&self, point: &Point3<f64>) -> bool {
        let place = self.volume.scene.to_world(point);
        self.volume.model.sdf.nearest_node(&place).is_some_and(|i| self.voxels.member[i])
    }

    fn random_point(&self, rng: &mut impl Rng) -> Point3<f64> {
        let grid = self.volume.model.sdf;
        let indices = &self.voxels.indices;
        let node = grid.position_of_index(indices[index_below(rng, indices.len())] as usize);
        let offset = Vector3::from_fn(|_, _| unit_uniform(rng) - 0.5) * grid.spacing_m;
        self.volume.scene.normalise(&(node + offset))
    }

    /// Share of the points drawn from the voxels; 0 without voxels.
    fn drawn_share(&self) -> f64 {
        if self.voxels.indices.is_empty() { 0.0 } else { STATE_SHARE }
    }
}

/// Points of the scene cube with weights: the mean of `weight * f(point)` over them estimates the mean of `f`
/// over the cube.
pub(crate) struct UniformBatch {
    /// Normalised positions, in the state the points are warped *out of*.
    pub points: Vec<Point3<f64>>,
    /// Ratio of uniform to proposal density.
    pub weights: Vec<f64>,
}

impl UniformBatch {
    /// Draws `count` points of the `here` state: a quarter uniformly, the rest from its occupied voxels and
    /// from those of the `other` state moved here by a random part (`way` leads from `here` to `other`). The
    /// weights are with respect to the whole mixture.
    pub(crate) fn draw(
        count: usize,
        here: OccupiedState<'_>,
        other: OccupiedState<'_>,
        motions: &Motions,
        way: Way,
        rng: &mut impl Rng,
    ) -> Self {
        let mixture = Mixture { here, other, motions, way };
        let points: Vec<Point3<f64>> = (0..count).map(|_| mixture.random_point(rng)).collect();
        let weights = points.par_iter().map(|x| mixture.importance_weight(x)).collect();
        Self { points, weights }
    }
}

/// The distribution from which points are drawn: see [`UniformBatch::draw`].
struct Mixture<'a> {
    here: OccupiedState<'a>,
    other: OccupiedState<'a>,
    motions: &'a Motions,
    way: Way,
}

impl Mixture<'_> {
    /// Shares of points from the cube, the voxels here and those of the other state: most of the cube is
    /// empty.
    fn proposal_shares(&self) -> [f64; 3] {
        [CUBE_SHARE, self.here.drawn_share(), self.other.drawn_share()]
    }

    fn random_point(&self, rng: &mut impl Rng) -> Point3<f64> {
        let [cube, own, other] = self.proposal_shares();
        // If a state has no voxels, its share goes to the others.
        let pick = unit_uniform(rng) * [cube, own, other].iter().sum::<f64>();
        if pick < cube {
            Point3::from(Vector3::from_fn(|_, _| 2.0 * unit_uniform(rng) - 1.0))
        } else if pick < cube + own {
            self.here.random_point(rng)
        } else {
            let part = index_below(rng, self.motions.parts.len());
            self.motions.apply(part, self.way.reverse(), &self.other.random_point(rng))
        }
    }

    /// Ratio of uniform to proposal density at a point.
    fn importance_weight(&self, x: &Point3<f64>) -> f64 {
        // A part moved it out of the cube, where the uniform density is 0.
        if x.coords.amax() > 1.0 {
            return 0.0;
        }
        let [cube, own, other] = self.proposal_shares();
        let mut density = cube;
        if self.here.contains(x) {
            density += own / self.here.voxels.share;
        }
        // Any part in an occupied voxel may have produced a point.
        let parts = self.motions.parts.len();
        let sources =
            (0..parts).filter(|i| self.other.contains(&self.motions.apply(*i, self.way, x))).count();
        density += other * sources as f64 / parts as f64 / self.other.voxels.share.max(1e-300);
        [cube, own, other].iter().sum::<f64>() / density
    }
}
