//! Near-surface consistency between the states (docs/method.md 12.8): a sample of one state, moved by its
//! part, must find the same signed distance and color in the other.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::neural::{
    config::ArticulationConfig,
    loss_term::{CHUNK, LossTerm},
    motion_params::{Motions, Way},
    ray_batch::{RayBatch, SAMPLES_PER_RAY},
    state_model::Volume,
};
use surface::ColorSample;

/// A batch of samples, the two states and the motions between them.
pub(crate) struct Consistency<'a> {
    pub batch: &'a RayBatch,
    pub source: &'a Volume<'a>,
    pub target: &'a Volume<'a>,
    pub motions: &'a Motions,
    /// The direction from source to target.
    pub way: Way,
    pub config: &'a ArticulationConfig,
}

impl Consistency<'_> {
    fn parts(&self) -> usize {
        self.motions.parts.len()
    }

    /// Visibility factor of a sample: 1 where both states saw it, the unseen weight where one did not. It has
    /// no gradient, or a point would gain by joining a motion that takes it out of sight.
    fn visibility(&self, sample: usize, images: &[Point3<f64>], p: &[f32]) -> f64 {
        let unseen = self.config.unseen_weight;
        if !self.batch.visible[sample] {
            return unseen;
        }
        let seen = images.iter().map(|y| f64::from(u8::from(self.target.is_visible(y))));
        // docs/method.md (12.14).
        let both: f64 = seen.zip(p).map(|(s, p)| s * f64::from(*p)).sum();
        unseen + (1.0 - unseen) * both
    }

    fn part_images(&self, point: &Point3<f64>) -> Vec<Point3<f64>> {
        (0..self.parts()).map(|i| self.motions.apply(i, self.way, point)).collect()
    }

    /// `L_s = sum w v rho(sum_i P_i sdf'(y_i) - sdf(x)) / sum w` over all samples; `probabilities` are those
    /// of the samples.
    pub(crate) fn sdf_loss(&self, probabilities: &[f32]) -> LossTerm {
        // A batch without a sample near the surface has zero loss, not NaN.
        let total: f64 = self.batch.weights.iter().sum::<f64>().max(1e-12);
        let parts = self.parts();
        let chunks = probabilities.par_chunks(CHUNK * parts).enumerate().map(|(chunk, p)| {
            let mut term = LossTerm::zero(p.len() / parts, parts);
            for (k, p) in p.chunks_exact(parts).enumerate() {
                let sample = chunk * CHUNK + k;
                if self.batch.weights[sample] > 0.0 {
                    self.add_sdf(sample, self.batch.weights[sample] / total, p, k, &mut term);
                }
            }
            term
        });
        LossTerm::concat(chunks.collect(), parts)
    }

    fn add_sdf(&self, sample: usize, weight: f64, p: &[f32], row: usize, term: &mut LossTerm) {
        let point = &self.batch.points[sample];
        let images = self.part_images(point);
        let v = self.visibility(sample, &images, p);
        let found: Vec<(f64, Vector3<f64>)> = images.iter().map(|y| self.target.sdf(y)).collect();
        // docs/method.md (12.16), first part.
        let blended: f64 = found.iter().zip(p).map(|(f, p)| f.0 * f64::from(*p)).sum();
        let residual = blended - self.batch.sdf[sample];
        let rho = residual.abs();
        let slope = if rho > 0.0 { residual.signum() } else { 0.0 };
        term.value += weight * v * rho;
        for (i, (sdf, gradient)) in found.iter().enumerate() {
            term.by_probabilities[row * p.len() + i] = (weight * (v * slope * sdf)) as f32;
            let by_image = gradient * (weight * v * slope * f64::from(p[i]));
            term.by_motions.add(self.motions, i, self.way, point, &by_image);
        }
    }

    /// `L_c = sum w v mean_rgb (sum_i P_i c'(y_i, R_i d) - c(x, d))^2 / sum w`, estimated from one sample a
    /// ray with the weight of the ray. View directions are constant in the gradients. `probabilities` are
    /// those of all samples.
    pub(crate) fn color_loss(&self, probabilities: &[f32]) -> LossTerm {
        let parts = self.parts();
        let mut term = LossTerm::zero(self.batch.points.len(), parts);
        let ray_weights: Vec<f64> =
            self.batch.weights.chunks_exact(SAMPLES_PER_RAY).map(|w| w.iter().sum()).collect();
        let total: f64 = ray_weights.iter().sum::<f64>().max(1e-12);
        // A color query costs far more than a distance query: rays without weight are skipped.
        let rays: Vec<usize> = (0..ray_weights.len()).filter(|r| ray_weights[*r] > 0.0).collect();
        let own_points: Vec<_> = rays
            .iter()
            .map(|r| self.source.scene.to_world(&self.batch.points[self.batch.colored[*r]]))
            .collect();
        let own_directions: Vec<_> = rays.iter().map(|r| self.batch.directions[*r]).collect();
        let mut points = Vec::new();
        let mut directions = Vec::new();
        for r in &rays {
            for i in 0..parts {
                let image = self.motions.apply(i, self.way, &self.batch.points[self.batch.colored[*r]]);
                points.push(self.target.scene.to_world(&image));
                directions.push(self.motions.turn(i, self.way, &self.batch.directions[*r]));
            }
        }
        let own = self.source.model.color.colors(&own_points, &own_directions);
        let found = self.target.model.color.colors(&points, &directions);
        for ((r, own), found) in rays.iter().zip(&own).zip(found.chunks_exact(parts)) {
            self.add_color(
                self.batch.colored[*r],
                ray_weights[*r] / total,
                probabilities,
                own,
                found,
                &mut term,
            );
        }
        term
    }

    fn add_color(
        &self,
        sample: usize,
        weight: f64,
        p: &[f32],
        own: &ColorSample,
        found: &[ColorSample],
        term: &mut LossTerm,
    ) {
        let parts = self.parts();
        let point = &self.batch.points[sample];
        let p = &p[sample * parts..(sample + 1) * parts];
        let v = self.visibility(sample, &self.part_images(point), p);
        // docs/method.md (12.16), second part.
        let blended: Vector3<f32> = found.iter().zip(p).map(|(c, p)| c.rgb * *p).sum();
        let difference: Vector3<f64> = (blended - own.rgb).cast();
        let error = difference.norm_squared() / 3.0;
        term.value += weight * v * error;
        for (i, c) in found.iter().enumerate() {
            let by_blend = difference * (weight * v * 2.0 / 3.0);
            term.by_probabilities[sample * parts + i] = by_blend.dot(&c.rgb.cast()) as f32;
            let by_image =
                // From meters to normalized units.
                c.jacobian.cast::<f64>().tr_mul(&by_blend) * (f64::from(p[i]) / self.target.scene.scale);
            term.by_motions.add(self.motions, i, self.way, point, &by_image);
        }
    }
}
