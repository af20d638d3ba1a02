//! The gradient by a half motion through the positions of the samples.

use std::ops::Range;

use nalgebra::Vector3;

use super::columns::{canonical_point, point_on_ray};
use super::half_motion::PoseGradient;
use super::pieces::{block_rays, ray_blocks};
use super::ray_batch::RayBatch;
use crate::FEATURES;
use crate::learner::Learner;
use crate::matrix::padded_rows;
use crate::simd::{LevelGeometry, LevelJacobian, PointColumns};
use geometry::Pose;

/// Gradient by a part's half motion, given the gradient by the encoded features of a group of rays, block by
/// block.
pub(super) fn by_position(
    field: &Learner,
    points: PointColumns<'_>,
    d_features: &[f32],
    batch: &RayBatch,
    rays: &Range<usize>,
    half: &Pose,
    half_side: f64,
) -> PoseGradient {
    let by_unit = by_unit_coordinates(field, points, d_features, batch, rays);
    let mut gradient = PoseGradient::default();
    let first = rays.start * batch.samples;
    for (i, by_unit) in by_unit.into_iter().enumerate() {
        if by_unit == [0.0; 3] {
            continue;
        }
        let ray = &batch.rays[(first + i) / batch.samples];
        let point = point_on_ray(ray, batch.distances[first + i]);
        // Size of a normalised unit in the part's cube.
        let by_image = Vector3::from(by_unit.map(f64::from)) * (0.5 / half_side);
        if ray.state == 0 {
            gradient.add_forward(half, &canonical_point(half, 0, &point), &by_image);
        } else {
            gradient.add_inverse(half, &point, &by_image);
        }
    }
    gradient
}

/// Gradient by the unit coordinates of every sample of a group.
fn by_unit_coordinates(
    field: &Learner,
    points: PointColumns<'_>,
    d_features: &[f32],
    batch: &RayBatch,
    rays: &Range<usize>,
) -> Vec<[f32; 3]> {
    let samples = batch.samples;
    let rows = padded_rows(FEATURES * field.params.levels.len());
    let mut sums = vec![[0.0f32; 3]; rays.len() * samples];
    let mut jacobian = vec![0.0f32; 8 * block_rays(samples) * samples];
    // Level by level, so that one table stays in the cache for many points.
    for (l, layout) in field.params.levels.iter().enumerate() {
        let level = LevelGeometry::new(layout);
        let table = &field.params.table[layout.offset..layout.offset + layout.entries * FEATURES];
        for block in ray_blocks(rays.clone(), samples) {
            let columns = block.start * samples..block.end * samples;
            let cols = columns.len();
            let first = columns.start - rays.start * samples;
            let d = &d_features[rows * first..][..rows * cols];
            let a = &d[FEATURES * l * cols..][..cols];
            let b = &d[(FEATURES * l + 1) * cols..][..cols];
            // Most rays pass through empty space, without any gradient.
            if a.iter().chain(b).all(|&x| x == 0.0) {
                continue;
            }
            let mut slices = jacobian[..8 * cols].chunks_exact_mut(cols);
            let mut four = || [(); 4].map(|()| slices.next().unwrap_or_default());
            let out = LevelJacobian { first: four(), second: four() };
            field.isa.encode_jacobian(level, table, points.columns_in(columns), out);
            for (i, sum) in sums[first..first + cols].iter_mut().enumerate() {
                for (k, s) in sum.iter_mut().enumerate() {
                    *s += a[i] * jacobian[(1 + k) * cols + i] + b[i] * jacobian[(5 + k) * cols + i];
                }
            }
        }
    }
    sums
}
