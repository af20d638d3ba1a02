//! What errors of poses and depth make of the residuals of a motion: one change by draw.
//! See docs/method.md 8.11.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::{
    joints::surface_draws::SurfaceDraws, observations::SurfaceSamples, samples::sample_index::SampleIndex,
};
use geometry::{NearestPoints, Pose};

/// Changes of the distances of surface points and of the ends of matches, by draw.
#[derive(Clone, Debug, Default)]
pub struct DrawnResiduals {
    /// Number of draws.
    count: usize,
    /// Of the points of each state, meters: of the first by every draw, then of the second, and so on.
    surfaces_m: [Vec<f32>; 2],
    /// Of `point1 - T point0` of every match, meters, in the same order.
    matches_m: Vec<Vector3<f32>>,
}

impl DrawnResiduals {
    /// At a motion `state1_from_state0`, from the displacements of a part's surface in both states; `matches`
    /// are the ends of its matches. The other state's surface is looked for within `radius_m`.
    #[must_use]
    pub fn new(
        draws: &[SurfaceDraws; 2],
        surfaces: [&SurfaceSamples; 2],
        matches: &[[Point3<f64>; 2]],
        motion: &Pose,
        radius_m: f64,
    ) -> Self {
        let count = draws[0].count().min(draws[1].count());
        if count == 0 {
            return Self::default();
        }
        let indices = surfaces.map(|s| SampleIndex::new(s, radius_m));
        let surfaces_m = [0, 1].map(|s| {
            let warp = if s == 0 { *motion } else { motion.inverse() };
            let along = |s: usize, i: usize, draw: usize| {
                surfaces[s].normals[i].dot(&draws[s].of(i)[draw].cast::<f64>())
            };
            let of_point = |i: usize| -> Vec<f32> {
                let point = warp * surfaces[s].points[i];
                let normal = warp * surfaces[s].normals[i];
                let partner = indices[1 - s].nearest(&point, &normal);
                // A point that lies too high is too far away; a surface that lies too high is too near.
                let change = |d: usize| partner.map_or(0.0, |j| along(s, i, d) - along(1 - s, j, d)) as f32;
                (0..count).map(change).collect()
            };
            let all: Vec<Vec<f32>> = (0..surfaces[s].points.len()).into_par_iter().map(of_point).collect();
            all.concat()
        });
        let nearest = surfaces.map(|s| NearestPoints::new(&s.points));
        let of_match = |ends: &[Point3<f64>; 2]| -> Vec<Vector3<f32>> {
            let [i, j] = [0, 1].map(|s| nearest[s].nearest(&ends[s]));
            let (Some((i, _)), Some((j, _))) = (i, j) else { return vec![Vector3::zeros(); count] };
            let turned = motion.rotation.cast::<f32>();
            (0..count).map(|d| draws[1].of(j)[d] - turned * draws[0].of(i)[d]).collect()
        };
        let all: Vec<Vec<Vector3<f32>>> = matches.par_iter().map(of_match).collect();
        Self { count, surfaces_m, matches_m: all.concat() }
    }

    /// Number of draws.
    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }

    /// Of a surface point of a state, meters.
    pub fn of_point(&self, state: usize, point: usize) -> &[f32] {
        self.surfaces_m[state].get(point * self.count..(point + 1) * self.count).unwrap_or_default()
    }

    /// Of a match, meters.
    pub fn of_match(&self, number: usize) -> &[Vector3<f32>] {
        self.matches_m.get(number * self.count..(number + 1) * self.count).unwrap_or_default()
    }
}
