//! Distances of fused surfaces from their readings.
//!
//! A thin panel fused on a coarse grid is displaced, and differently in each pose and from other views. Such
//! errors are correlated over a side of a part: they shift its motion without leaving a residual, so they are
//! measured here.

use rayon::prelude::*;

use crate::{
    observations::SurfaceSamples,
    samples::{sample_index::SampleIndex, surface_graph::SAME_NORMAL},
};
use capture::{GRAZING_COSINE, NoiseConfig, RgbdFrame};
use geometry::Pose;

/// Heights of the readings above the surfaces of a part, averaged over a radius, meters; `None` where no
/// frame shows one.
pub(crate) struct ReadingHeights {
    of: [Vec<Option<f64>>; 2],
}

impl ReadingHeights {
    /// Readings farther from a surface than `reach_m` plus their noise are of another one.
    pub(crate) fn new(
        surfaces: [&SurfaceSamples; 2],
        frames: [&[RgbdFrame]; 2],
        noise: &NoiseConfig,
        radius_m: f64,
        reach_m: f64,
    ) -> Self {
        Self { of: [0, 1].map(|s| heights_m(surfaces[s], frames[s], noise, radius_m, reach_m)) }
    }

    /// For every sample of each state: the height of the readings above it, less the height of the other
    /// state's readings above its partner (under the motion, within `radius_m`). The distance from the
    /// partner is too small by this much, meters; 0 where either height is unknown.
    pub(crate) fn offsets_m(
        &self,
        surfaces: [&SurfaceSamples; 2],
        state1_from_state0: &Pose,
        radius_m: f64,
    ) -> [Vec<f64>; 2] {
        let indices = surfaces.map(|s| SampleIndex::new(s, radius_m));
        [0, 1].map(|s| {
            let warp = if s == 0 { *state1_from_state0 } else { state1_from_state0.inverse() };
            let samples = (0..surfaces[s].points.len()).into_par_iter();
            let offsets_m = samples.map(|i| -> Option<f64> {
                let point = warp * surfaces[s].points[i];
                let normal = warp * surfaces[s].normals[i];
                Some(self.of[s][i]? - self.of[1 - s][indices[1 - s].nearest_sample(&point, &normal)?]?)
            });
            offsets_m.map(|offset_m| offset_m.unwrap_or(0.0)).collect()
        })
    }
}

/// Shrinks offsets towards zero; those below `noise_m`, which averaged readings show by chance, become zero.
/// See docs/method.md (8.7).
pub(crate) fn clear_offsets(offsets_m: Vec<f64>, noise_m: f64) -> Vec<f64> {
    offsets_m.into_iter().map(|o| o * o * o / (o * o + noise_m * noise_m)).collect()
}

/// Root mean square of the known offsets of state 0's samples, meters; 0 where none is known.
pub(crate) fn surface_error_m(offsets_m: &[f64]) -> f64 {
    let (sum, count) =
        offsets_m.iter().filter(|d| **d != 0.0).fold((0.0, 0usize), |(sum, n), d| (sum + d * d, n + 1));
    (sum / count.max(1) as f64).sqrt()
}

/// Mean height of the readings above every sample and its neighbors, meters.
fn heights_m(
    surface: &SurfaceSamples,
    frames: &[RgbdFrame],
    noise: &NoiseConfig,
    radius_m: f64,
    reach_m: f64,
) -> Vec<Option<f64>> {
    let samples = 0..surface.points.len();
    let index = SampleIndex::new(surface, radius_m);
    let own: Vec<[f64; 2]> =
        samples.clone().into_par_iter().map(|i| weighed_height(surface, i, frames, noise, reach_m)).collect();
    samples.into_par_iter().map(|i| mean_height(surface, i, &own, &index, radius_m, reach_m)).collect()
}

/// Mean of the heights above a sample and its neighbors on the same side; `None` without a reading.
fn mean_height(
    surface: &SurfaceSamples,
    sample: usize,
    heights: &[[f64; 2]],
    index: &SampleIndex,
    radius_m: f64,
    reach_m: f64,
) -> Option<f64> {
    let point = &surface.points[sample];
    let normal = &surface.normals[sample];
    let [mut sum, mut weights] = [0.0; 2];
    index.visit_around(point, |j, place| {
        let offset = place - point;
        // The other side of a thin panel is as near.
        let near = offset.norm_squared() < radius_m * radius_m && offset.dot(normal).abs() < reach_m;
        if near && normal.dot(&surface.normals[j]) > SAME_NORMAL {
            sum += heights[j][0];
            weights += heights[j][1];
        }
    });
    (weights > 0.0).then(|| sum / weights)
}

/// Weighted sum of the heights of the readings above a sample, and the sum of the weights.
fn weighed_height(
    surface: &SurfaceSamples,
    sample: usize,
    frames: &[RgbdFrame],
    noise: &NoiseConfig,
    reach_m: f64,
) -> [f64; 2] {
    let point = surface.points[sample];
    let normal = surface.normals[sample];
    frames.iter().fold([0.0; 2], |[sum, weights], frame| {
        let Some(pixel) = frame.intrinsics.pixel_of(&frame.in_camera(&point)) else { return [sum, weights] };
        let Some(reading) = frame.world_point(pixel) else { return [sum, weights] };
        let sight = (frame.world_from_camera.translation.vector - reading.coords).normalize();
        let cosine = sight.dot(&normal);
        let height_m = normal.dot(&(reading - point));
        // Depth errors are along the ray; the height sees their component along the normal.
        let sigma_m = cosine * frame.sigma_m(pixel, noise);
        if cosine < GRAZING_COSINE || height_m.abs() > reach_m + 3.0 * sigma_m {
            return [sum, weights];
        }
        let weight = sigma_m.powi(-2);
        [sum + weight * height_m, weights + weight]
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;
    use capture::analytic::{cuboid, looking_at_origin, view_of};
    use geometry::Intrinsics;

    /// The upper side of a box, a plate of samples 0.02 m high that lie `above_m` over it.
    fn plate(above_m: f64) -> SurfaceSamples {
        let at =
            |i: i32| Point3::new(0.02 * f64::from(i % 10 - 5), 0.02 * f64::from(i / 10 - 5), 0.02 + above_m);
        let points: Vec<Point3<f64>> = (0..100).map(at).collect();
        SurfaceSamples {
            normals: vec![Vector3::z(); points.len()],
            colors: vec![[0.5; 3]; points.len()],
            points,
        }
    }

    #[test]
    fn what_one_state_shows_too_high_is_measured() {
        let noise =
            NoiseConfig { constant_m: 0.001, quadratic_per_m: 0.0, edge_sigmas: 6.0, grazing_cosine: 0.15 };
        let k = Intrinsics { width: 320, height: 240, fx: 340.0, fy: 340.0, cx: 161.0, cy: 118.0 };
        let block = cuboid(Vector3::new(0.2, 0.2, 0.02));
        let frames = [Point3::new(0.1, 0.2, 0.7), Point3::new(-0.3, 0.1, 0.6)]
            .map(|eye| view_of(&block, k, looking_at_origin(eye)));
        let error_m = |above_m: [f64; 2]| {
            let plates = above_m.map(plate);
            let heights = ReadingHeights::new(plates.each_ref(), [&frames, &frames], &noise, 0.03, 0.005);
            let offsets_m = heights.offsets_m(plates.each_ref(), &Pose::identity(), 0.03);
            assert!((surface_error_m(&offsets_m[0]) - surface_error_m(&offsets_m[1])).abs() < 2e-4);
            surface_error_m(&offsets_m[0])
        };
        assert!(error_m([0.0, 0.0]) < 2e-4, "{}", error_m([0.0, 0.0]));
        assert!((error_m([0.0, 0.002]) - 0.002).abs() < 3e-4, "{}", error_m([0.0, 0.002]));
        assert!(error_m([0.002, 0.002]) < 3e-4, "what both states share is no error of the motion");
    }
}
