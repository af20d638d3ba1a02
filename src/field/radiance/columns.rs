//! The samples of a step in the canonical frame of every part.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::ray_batch::{Ray, RayBatch};
use crate::simd::PointColumns;
use geometry::Pose;

/// Transforms a point of a state to the canonical frame: docs/method.md (12.20).
pub(super) fn canonical_point(half: &Pose, state: usize, point: &Point3<f64>) -> Point3<f64> {
    if state == 0 { half * point } else { half.inverse_transform_point(point) }
}

/// Rotates a direction of a state to the canonical frame.
pub(super) fn canonical_direction(half: &Pose, state: usize, direction: &Vector3<f64>) -> Vector3<f64> {
    if state == 0 { half * direction } else { half.inverse_transform_vector(direction) }
}

/// Position of a sample in normalised coordinates.
pub(super) fn point_on_ray(ray: &Ray, distance: f64) -> Point3<f64> {
    ray.origin + ray.direction * distance
}

/// The samples of a step in the canonical frame of one part.
#[derive(Default)]
pub(super) struct PartColumns {
    /// Coordinates in the part's cube, `[0, 1]^3`.
    pub x: Vec<f32>,
    pub y: Vec<f32>,
    pub z: Vec<f32>,
    pub inside: Vec<bool>,
    pub directions: Vec<Vector3<f64>>,
    pub features: Vec<f32>,
    pub d_features: Vec<f32>,
}

impl PartColumns {
    pub(super) fn point_columns(&self) -> PointColumns<'_> {
        PointColumns { x: &self.x, y: &self.y, z: &self.z }
    }

    /// Transforms the samples of a batch to the canonical frame.
    pub(super) fn fill_from_batch(&mut self, batch: &RayBatch, half: &Pose, half_side: f64) {
        let n = batch.distances.len();
        for axis in [&mut self.x, &mut self.y, &mut self.z] {
            axis.resize(n, 0.0);
        }
        self.inside.resize(n, false);
        self.directions.clear();
        self.directions.extend(batch.rays.iter().map(|r| canonical_direction(half, r.state, &r.direction)));
        let per = batch.samples;
        let axes = self.x.par_chunks_mut(per).zip(self.y.par_chunks_mut(per)).zip(self.z.par_chunks_mut(per));
        let rays = batch.rays.par_iter().zip(batch.distances.par_chunks(per));
        axes.zip(self.inside.par_chunks_mut(per)).zip(rays).for_each(
            |((((x, y), z), inside), (ray, distances))| {
                for (i, &t) in distances.iter().enumerate() {
                    let p = canonical_point(half, ray.state, &point_on_ray(ray, t));
                    let unit = p.coords.map(|c| 0.5 * (c / half_side + 1.0));
                    (x[i], y[i], z[i]) = (unit.x as f32, unit.y as f32, unit.z as f32);
                    inside[i] = unit.iter().all(|u| (0.0..=1.0).contains(u));
                }
            },
        );
    }
}
