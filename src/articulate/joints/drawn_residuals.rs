//! Changes of the residuals of a motion by drawn errors of poses and depth: one change per random draw. See
//! docs/method.md 8.11.

use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;

use crate::{
    joints::surface_draws::SurfaceDraws, observations::SurfaceSamples, samples::sample_index::SampleIndex,
};
use geometry::{NearestPoints, Pose};

/// Changes of surface point distances and of match ends, per draw.
#[derive(Clone, Debug, Default)]
pub struct DrawnResiduals {
    /// Number of draws.
    count: usize,
    /// Change of the distance of the points of each state, meters: all draws of the first point, then of the
    /// second, and so on.
    surfaces_m: [Vec<f32>; 2],
    /// Mean square of these changes over the draws, by point, square meters.
    variances_m2: [Vec<f64>; 2],
    /// Change of `point1 - T point0` of every match, meters, in the same order.
    matches_m: Vec<Vector3<f32>>,
    /// Covariance of each match by these changes, square meters.
    covariances_m2: Vec<Matrix3<f64>>,
}

impl DrawnResiduals {
    /// Computes the changes at a motion `state1_from_state0` from the displacements of a part's surface in
    /// both states; `matches` are the ends of its matches. The partner on the other state's surface is looked
    /// for within `radius_m`.
    pub fn new(
        draws: &[SurfaceDraws; 2],
        surfaces: [&SurfaceSamples; 2],
        matches: &[[Point3<f64>; 2]],
        motion: &Pose,
        radius_m: f64,
    ) -> Self {
        let count = draws[0].draw_count().min(draws[1].draw_count());
        if count == 0 {
            return Self::default();
        }
        let indices = surfaces.map(|s| SampleIndex::new(s, radius_m));
        let surfaces_m = [0, 1].map(|s| {
            let warp = if s == 0 { *motion } else { motion.inverse() };
            let all: Vec<Vec<f32>> = (0..surfaces[s].points.len())
                .into_par_iter()
                .map(|i| {
                    let point = warp * surfaces[s].points[i];
                    let normal = warp * surfaces[s].normals[i];
                    let Some(j) = indices[1 - s].nearest_sample(&point, &normal) else {
                        return vec![0.0; count];
                    };
                    // A point displaced upwards is too far away; a surface displaced upwards is too near.
                    let own_m = heights_m(&draws[s], i, &surfaces[s].normals[i]);
                    let partner_m = heights_m(&draws[1 - s], j, &surfaces[1 - s].normals[j]);
                    own_m.zip(partner_m).take(count).map(|(own, partner)| (own - partner) as f32).collect()
                })
                .collect();
            all.concat()
        });
        let nearest = surfaces.map(|s| NearestPoints::new(&s.points));
        let turned = motion.rotation.cast::<f32>();
        let all: Vec<Vec<Vector3<f32>>> = matches
            .par_iter()
            .map(|ends| {
                let [i, j] = [0, 1].map(|s| nearest[s].nearest_one(&ends[s]));
                let (Some((i, _)), Some((j, _))) = (i, j) else { return vec![Vector3::zeros(); count] };
                (0..count)
                    .map(|d| draws[1].displacements_of(j)[d] - turned * draws[0].displacements_of(i)[d])
                    .collect()
            })
            .collect();
        let variances_m2 = surfaces_m.each_ref().map(|all| all.chunks(count).map(mean_square).collect());
        let covariances_m2 = all.iter().map(|changes_m| mean_product(changes_m)).collect();
        Self { count, surfaces_m, variances_m2, matches_m: all.concat(), covariances_m2 }
    }

    /// Number of draws.
    pub fn draw_count(&self) -> usize {
        self.count
    }

    /// Changes of the distance of a surface point of a state by draw, meters.
    pub fn of_point(&self, state: usize, point: usize) -> &[f32] {
        self.surfaces_m[state].get(point * self.count..(point + 1) * self.count).unwrap_or_default()
    }

    /// Variance of the distance of a surface point of a state by errors of poses and depth, square meters.
    pub fn variance_of_point_m2(&self, state: usize, point: usize) -> f64 {
        self.variances_m2[state].get(point).copied().unwrap_or(0.0)
    }

    /// Covariance of `point1 - T point0` of a match by the same errors, square meters.
    pub fn covariance_of_match_m2(&self, number: usize) -> Matrix3<f64> {
        self.covariances_m2.get(number).copied().unwrap_or_default()
    }

    /// Changes of a match by draw, meters.
    pub fn of_match(&self, number: usize) -> &[Vector3<f32>] {
        self.matches_m.get(number * self.count..(number + 1) * self.count).unwrap_or_default()
    }
}

/// Mean square of some lengths, square meters.
fn mean_square(lengths_m: &[f32]) -> f64 {
    lengths_m.iter().map(|m| f64::from(*m).powi(2)).sum::<f64>() / lengths_m.len().max(1) as f64
}

/// Mean product of some vectors with themselves, square meters.
fn mean_product(changes_m: &[Vector3<f32>]) -> Matrix3<f64> {
    let changes = changes_m.iter().map(|m| m.cast::<f64>());
    changes.map(|m| m * m.transpose()).sum::<Matrix3<f64>>() / changes_m.len().max(1) as f64
}

/// Displacements of a sample along its normal, by draw, meters.
fn heights_m(draws: &SurfaceDraws, sample: usize, normal: &Vector3<f64>) -> impl Iterator<Item = f64> {
    draws.displacements_of(sample).iter().map(|displacement| normal.dot(&displacement.cast::<f64>()))
}
