//! Near-surface consistency between the states (docs/method.md 12.8): a sample of one state, moved by its
//! part, must find the same signed distance and color in the other.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::neural::{
    config::{ArticulationConfig, ColorSpace, MethodVersion, SdfResidual},
    loss_term::{CHUNK, LossTerm},
    motion_params::{Motions, Way},
    ray_batch::RayBatch,
    state_model::Volume,
};
use surface::ColorSample;

/// Colors are kept this far from 0 and 1 before the logit; chosen: less than half a step of 8-bit colors.
const LOGIT_MARGIN: f32 = 1e-3;

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

/// Visibility factor `v = offset + slope * V`, `V = seen * sum_i P_i seen_i`: docs/method.md (12.14).
#[derive(Clone, Copy)]
struct Discount {
    offset: f64,
    slope: f64,
}

impl Discount {
    fn of(config: &ArticulationConfig) -> Self {
        let unseen = config.unseen_weight;
        match config.compatibility.visibility {
            MethodVersion::Paper => Self { offset: unseen, slope: 1.0 - unseen },
            MethodVersion::Released => Self { offset: 1.0, slope: unseen - 1.0 },
        }
    }
}

impl Consistency<'_> {
    fn parts(&self) -> usize {
        self.motions.parts.len()
    }

    /// Visibility factor of a sample, and its derivative by every probability.
    fn visibility(&self, sample: usize, images: &[Point3<f64>], p: &[f32]) -> (f64, Vec<f64>) {
        let discount = Discount::of(self.config);
        if !self.batch.visible[sample] {
            return (discount.offset, vec![0.0; p.len()]);
        }
        let seen: Vec<f64> = images.iter().map(|y| f64::from(u8::from(self.target.is_visible(y)))).collect();
        // docs/method.md (12.14).
        let both: f64 = seen.iter().zip(p).map(|(s, p)| s * f64::from(*p)).sum();
        // Without this gradient no point gains by joining a motion that takes it out of sight.
        let pass = if self.config.visibility_gradient { discount.slope } else { 0.0 };
        (discount.offset + discount.slope * both, seen.iter().map(|s| pass * s).collect())
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
        let (v, by_p) = self.visibility(sample, &images, p);
        let found: Vec<(f64, Vector3<f64>)> = images.iter().map(|y| self.target.sdf(y)).collect();
        // docs/method.md (12.16), first part.
        let blended: f64 = found.iter().zip(p).map(|(f, p)| f.0 * f64::from(*p)).sum();
        let sigma = self.batch.sigma[sample / self.batch.samples_per_ray];
        let (rho, slope) = penalty(blended - self.batch.sdf[sample], sigma, self.config.sdf_residual);
        term.value += weight * v * rho;
        for (i, (sdf, gradient)) in found.iter().enumerate() {
            term.by_probabilities[row * p.len() + i] = (weight * (v * slope * sdf + by_p[i] * rho)) as f32;
            let by_image = gradient * (weight * v * slope * f64::from(p[i]));
            term.by_motions.add(self.motions, i, self.way, point, &by_image);
        }
    }

    /// `L_c = sum w v mean_rgb (sum_i P_i c'(y_i, R_i d) - c(x, d))^2 / sum w`, estimated from one sample a
    /// ray with the weight of the ray. View directions are constant in the gradients. `probabilities` are
    /// those of all samples.
    pub(crate) fn color_loss(&self, probabilities: &[f32]) -> LossTerm {
        let parts = self.parts();
        let samples = self.batch.samples_per_ray;
        let mut term = LossTerm::zero(self.batch.points.len(), parts);
        let ray_weights: Vec<f64> =
            self.batch.weights.chunks_exact(samples).map(|w| w.iter().sum()).collect();
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
            let found: Vec<ColorSample> = found.iter().map(|c| self.in_space(c)).collect();
            self.add_color(
                self.batch.colored[*r],
                ray_weights[*r] / total,
                probabilities,
                &self.in_space(own),
                &found,
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
        let (v, by_p) = self.visibility(sample, &self.part_images(point), p);
        // docs/method.md (12.16), second part.
        let blended: Vector3<f32> = found.iter().zip(p).map(|(c, p)| c.rgb * *p).sum();
        let difference: Vector3<f64> = (blended - own.rgb).cast();
        let error = difference.norm_squared() / 3.0;
        term.value += weight * v * error;
        for (i, c) in found.iter().enumerate() {
            let by_blend = difference * (weight * v * 2.0 / 3.0);
            term.by_probabilities[sample * parts + i] =
                (by_blend.dot(&c.rgb.cast()) + weight * by_p[i] * error) as f32;
            let by_image =
                // From meters to normalized units.
                c.jacobian.cast::<f64>().tr_mul(&by_blend) * (f64::from(p[i]) / self.target.scene.scale);
            term.by_motions.add(self.motions, i, self.way, point, &by_image);
        }
    }

    /// A color in the space in which colors are compared.
    fn in_space(&self, color: &ColorSample) -> ColorSample {
        match self.config.compatibility.color_space {
            ColorSpace::Rgb => *color,
            ColorSpace::Logit => {
                let mut out = *color;
                for k in 0..3 {
                    let c = color.rgb[k].clamp(LOGIT_MARGIN, 1.0 - LOGIT_MARGIN);
                    let inside = c == color.rgb[k];
                    out.rgb[k] = (c / (1.0 - c)).ln();
                    let slope = if inside { 1.0 / (c * (1.0 - c)) } else { 0.0 };
                    out.jacobian.row_mut(k).scale_mut(slope);
                }
                out
            }
        }
    }
}

/// Penalty of a residual and its derivative, in truncation distances.
fn penalty(residual: f64, sigma: f64, kind: SdfResidual) -> (f64, f64) {
    let size = residual.abs();
    match kind {
        SdfResidual::Absolute => (size, if size > 0.0 { residual.signum() } else { 0.0 }),
        SdfResidual::NoiseScaled { sigmas } => {
            // The quadratic part ends at half a truncation distance at most, so an absolute part always
            // follows.
            let knee = (sigmas * sigma).clamp(1e-9, 0.5);
            if size < knee {
                (0.5 * residual * residual / knee, residual / knee)
            } else if size < 1.0 {
                (size - 0.5 * knee, residual.signum())
            } else {
                // Beyond the truncation distance the other state knows no surface, so nothing pulls.
                (1.0 - 0.5 * knee, 0.0)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slope_of_a_penalty_is_its_derivative() {
        for kind in [SdfResidual::Absolute, SdfResidual::NoiseScaled { sigmas: 3.0 }] {
            for r in [-1.5, -0.7, -0.04, 0.03, 0.2, 0.99, 1.2] {
                let numeric = (penalty(r + 1e-6, 0.02, kind).0 - penalty(r - 1e-6, 0.02, kind).0) / 2e-6;
                assert!((numeric - penalty(r, 0.02, kind).1).abs() < 1e-6, "{kind:?} {r}");
            }
        }
    }
}
