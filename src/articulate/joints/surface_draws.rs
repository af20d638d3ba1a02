//! Displacements of a surface by drawn errors of poses and depth: one displacement per random draw.
//!
//! A fused surface is the mean of its views and follows their errors. See docs/method.md 8.11.

use nalgebra::{Matrix3x6, Matrix6, Point3, Vector3, Vector6};
use rayon::prelude::*;

use crate::observations::SurfaceSamples;
use capture::{ErrorDraw, GRAZING_COSINE, NoiseConfig, RgbdFrame};

/// Displacements of the samples of one state, meters.
#[derive(Clone, Debug, Default)]
pub struct SurfaceDraws {
    /// Number of draws.
    count: usize,
    /// Displacement of sample 0 in every draw, then of sample 1, and so on, meters.
    displacements_m: Vec<Vector3<f32>>,
}

impl SurfaceDraws {
    /// Draws the displacements of the samples of state number `state`. Readings farther from a sample than
    /// `reach_m` plus their noise are of another surface. See docs/method.md (8.17).
    pub fn new(
        draws: &[ErrorDraw],
        state: usize,
        samples: &SurfaceSamples,
        frames: &[RgbdFrame],
        noise: &NoiseConfig,
        reach_m: f64,
    ) -> Self {
        if draws.is_empty() || !draws.iter().all(|d| d.covers(state, frames.len())) {
            return Self::default();
        }
        let all: Vec<Vec<Vector3<f32>>> = samples
            .points
            .par_iter()
            .zip(&samples.normals)
            .map(|(point, normal)| displacements_m(draws, state, point, normal, frames, noise, reach_m))
            .collect();
        Self { count: draws.len(), displacements_m: all.concat() }
    }

    /// `samples` samples, all with the same displacements, one vector per draw, meters.
    #[cfg(test)]
    pub fn alike(samples: usize, displacements_m: &[Vector3<f32>]) -> Self {
        Self { count: displacements_m.len(), displacements_m: displacements_m.repeat(samples) }
    }

    /// The motion of the chosen samples as one body in every draw (least squares): translation, meters, and
    /// rotation, radians, about the world's origin. Empty where they do not determine one.
    pub fn rigid_motions(&self, points: &[Point3<f64>], chosen: &[usize]) -> Vec<Vector6<f64>> {
        let slopes: Vec<Matrix3x6<f64>> = chosen.iter().map(|&i| displacement_slope(&points[i])).collect();
        let information: Matrix6<f64> = slopes.iter().map(|slope| slope.tr_mul(slope)).sum();
        let Some(information) = information.cholesky() else { return Vec::new() };
        let mut motions = Vec::with_capacity(self.count);
        for draw in 0..self.count {
            let samples = chosen.iter().zip(&slopes);
            let right: Vector6<f64> =
                samples.map(|(&i, slope)| slope.tr_mul(&self.displacements_of(i)[draw].cast::<f64>())).sum();
            motions.push(information.solve(&right));
        }
        motions
    }

    /// The displacements less those of a motion of all points as one body, one motion per draw.
    pub fn without_motions(mut self, motions: &[Vector6<f64>], points: &[Point3<f64>]) -> Self {
        for (x, all) in points.iter().zip(self.displacements_m.chunks_mut(self.count.max(1))) {
            for (displacement, motion) in all.iter_mut().zip(motions) {
                let shift = motion.fixed_rows::<3>(0);
                let turn = motion.fixed_rows::<3>(3);
                *displacement -= (shift + turn.cross(&x.coords)).cast::<f32>();
            }
        }
        self
    }

    /// Number of draws.
    pub fn draw_count(&self) -> usize {
        self.count
    }

    /// Displacements of one sample by draw, meters.
    pub fn displacements_of(&self, sample: usize) -> &[Vector3<f32>] {
        &self.displacements_m[sample * self.count..(sample + 1) * self.count]
    }

    /// The displacements of the chosen samples only.
    #[must_use]
    pub fn chosen_samples(&self, samples: &[usize]) -> Self {
        let displacements_m = samples.iter().flat_map(|&i| self.displacements_of(i)).copied().collect();
        Self { count: self.count, displacements_m }
    }
}

/// Derivative of the displacement of a point by a motion (v, w): it is `v + w x point`.
fn displacement_slope(point: &Point3<f64>) -> Matrix3x6<f64> {
    let mut slope = Matrix3x6::identity();
    slope.fixed_view_mut::<3, 3>(0, 3).copy_from(&-point.coords.cross_matrix());
    slope
}

/// Displacements of one sample of a state by draw, meters: the mean over all frames with a reading of it.
fn displacements_m(
    draws: &[ErrorDraw],
    state: usize,
    point: &Point3<f64>,
    normal: &Vector3<f64>,
    frames: &[RgbdFrame],
    noise: &NoiseConfig,
    reach_m: f64,
) -> Vec<Vector3<f32>> {
    let mut sums = vec![Vector3::zeros(); draws.len()];
    let mut weights = 0.0;
    for (f, frame) in frames.iter().enumerate() {
        let at = frame.in_camera(point);
        let Some(pixel) = frame.intrinsics.pixel_of(&at) else { continue };
        let sigma_m = frame.sigma_m(pixel, noise);
        let read_m = f64::from(frame.depth_m[pixel]);
        let sight = (frame.world_from_camera.translation.vector - point.coords).normalize();
        let cosine = sight.dot(normal);
        if read_m <= 0.0 || cosine < GRAZING_COSINE || (read_m - at.z).abs() > reach_m + 3.0 * sigma_m {
            continue;
        }
        // The weight of a view in fusion: docs/method.md (3.2).
        let weight = cosine / (sigma_m * sigma_m);
        let width = frame.intrinsics.width;
        let pixel = [(pixel % width) as f64, (pixel / width) as f64];
        weights += weight;
        for (sum, draw) in sums.iter_mut().zip(draws) {
            let pose = &frame.world_from_camera;
            *sum += weight * draw.displacement_m([state, f], pose, &at.coords, pixel);
        }
    }
    let share = if weights > 0.0 { 1.0 / weights } else { 0.0 };
    sums.into_iter().map(|sum| (share * sum).cast::<f32>()).collect()
}
