//! Losses of a rendered ray and their derivatives.

use serde::{Deserialize, Serialize};

use super::RadianceConfig;
use super::ray_batch::Ray;

/// Weight of the binary cross entropy between opacity and mask.
/// derived: the published one
pub(super) const MASK_WEIGHT: f64 = 0.1;
/// Least distance of opacities from 0 and 1 in the cross entropy, to keep its logarithms finite.
/// chosen: limits the loss of one ray to 7
const OPACITY_MARGIN: f64 = 1e-3;
/// Least opacity of a ray for which its parts' shares are meaningful. chosen: a hundredth
const SHARED_OPACITY: f64 = 0.01;
/// Smallest share in a logarithm. chosen: smaller shares add less than 2e-5 to an entropy
const SMALLEST_SHARE: f64 = 1e-6;

/// Loss terms of a step with their weights applied; the loss is their sum.
///
/// Each term is a mean over the rays of a state (`depth`: over those with a reading), averaged over both
/// states. `color` is the smooth L1 loss (beta 1) of the rendered color, averaged over the channels; `mask`
/// is the binary cross entropy between opacity and mask; `depth` is the squared error of the rendered ray
/// distance in normalised units; `part_entropy` is the entropy of the parts' shares `O_k / sum O` of a ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RadianceLosses {
    /// Color term (Liu, Mahdavi-Amiri and Savva 2023).
    pub color: f64,
    /// Mask term (Liu, Mahdavi-Amiri and Savva 2023).
    pub mask: f64,
    /// Depth term (Weng et al. 2024, supplement).
    pub depth: f64,
    /// Part probability term, binary for two parts (Weng et al. 2024, supplement, equations 30 to 32). The
    /// published one affects only the fields; here it affects the motions too.
    pub part_entropy: f64,
}

impl RadianceLosses {
    /// Sum of the terms.
    pub fn total_loss(&self) -> f64 {
        self.color + self.mask + self.depth + self.part_entropy
    }

    /// Adds the terms of other rays.
    pub(super) fn add_terms(&mut self, other: &Self) {
        self.color += other.color;
        self.mask += other.mask;
        self.depth += other.depth;
        self.part_entropy += other.part_entropy;
    }
}

/// Rendered values of a ray. `color = 1 + sum_ki w_ki (c_ki - 1)`, on a white background.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Rendered {
    pub color: [f64; 3],
    /// `O_k = sum_i w_ki` of every part.
    pub opacities: Vec<f64>,
    /// `sum_ki w_ki t_i`, normalised units; not divided by the opacity.
    pub distance: f64,
}

/// Derivatives of a ray's loss by its rendered values.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct RenderedGradient {
    pub color: [f64; 3],
    pub opacities: Vec<f64>,
    pub distance: f64,
}

/// Weight of a ray in its state's mean over rays, and over rays with a reading.
#[derive(Clone, Copy, Debug)]
pub(super) struct RayShare {
    pub ray: f64,
    pub reading: f64,
}

/// Loss of one ray with its derivatives. See docs/method.md (12.22).
pub(super) fn ray_loss(
    ray: &Ray,
    shown: &Rendered,
    share: RayShare,
    config: &RadianceConfig,
) -> (RadianceLosses, RenderedGradient) {
    let mut loss = RadianceLosses::default();
    let mut by =
        RenderedGradient { opacities: vec![0.0; shown.opacities.len()], ..RenderedGradient::default() };
    for c in 0..3 {
        let excess = shown.color[c] - ray.color[c];
        let far = excess.abs() >= 1.0;
        loss.color += share.ray / 3.0 * if far { excess.abs() - 0.5 } else { 0.5 * excess * excess };
        by.color[c] = share.ray / 3.0 * excess.clamp(-1.0, 1.0);
    }

    let opacity: f64 = shown.opacities.iter().sum();
    let inner = opacity.clamp(OPACITY_MARGIN, 1.0 - OPACITY_MARGIN);
    let (probability, sign) = if ray.object { (inner, 1.0) } else { (1.0 - inner, -1.0) };
    let weight = MASK_WEIGHT * share.ray;
    loss.mask = -weight * probability.ln();
    if inner == opacity {
        by.opacities.iter_mut().for_each(|g| *g -= weight * sign / probability);
    }

    if let Some(distance) = ray.distance {
        let weight = config.depth_weight * share.reading;
        let excess = shown.distance - distance;
        loss.depth = weight * excess * excess;
        by.distance = 2.0 * weight * excess;
    }

    // docs/method.md (12.23).
    if config.part_entropy_weight > 0.0 && opacity > SHARED_OPACITY {
        let weight = config.part_entropy_weight * share.ray;
        let log = |o: f64| (o / opacity).max(SMALLEST_SHARE).ln();
        let entropy: f64 = shown.opacities.iter().map(|&o| -o / opacity * log(o)).sum();
        loss.part_entropy = weight * entropy;
        for (g, &o) in by.opacities.iter_mut().zip(&shown.opacities) {
            // d(-sum p ln p) / dO_k with p = O / sum O.
            *g += weight * (-log(o) - entropy) / opacity;
        }
    }
    (loss, by)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Vector3};

    fn ray(object: bool, distance: Option<f64>) -> Ray {
        Ray {
            state: 0,
            origin: Point3::origin(),
            direction: Vector3::z(),
            step: 0.1,
            color: [0.2, 0.9, -0.6],
            object,
            distance,
        }
    }

    fn config(part_entropy_weight: f64) -> RadianceConfig {
        RadianceConfig { part_entropy_weight, ..RadianceConfig::default() }
    }

    const SHARE: RayShare = RayShare { ray: 0.25, reading: 0.5 };

    #[test]
    fn derivatives_agree_with_differences() {
        for (object, distance) in [(true, Some(1.3)), (false, None)] {
            let ray = ray(object, distance);
            let config = config(0.3);
            let base = Rendered { color: [0.5, 0.7, 0.8], opacities: vec![0.3, 0.1, 0.2], distance: 0.9 };
            let (_, by) = ray_loss(&ray, &base, SHARE, &config);
            let check = |nudge: &dyn Fn(&mut Rendered, f64), expected: f64| {
                let value = |h: f64| {
                    let mut shown = base.clone();
                    nudge(&mut shown, h);
                    ray_loss(&ray, &shown, SHARE, &config).0.total_loss()
                };
                let numeric = (value(1e-6) - value(-1e-6)) / 2e-6;
                assert!((numeric - expected).abs() < 1e-8, "{numeric} {expected}");
            };
            for k in 0..3 {
                check(&|s, h| s.color[k] += h, by.color[k]);
                check(&|s, h| s.opacities[k] += h, by.opacities[k]);
            }
            check(&|s, h| s.distance += h, by.distance);
        }
    }

    #[test]
    fn terms_have_their_known_values() {
        let shown = Rendered { color: [0.2, 0.4, 1.0], opacities: vec![0.25, 0.25], distance: 1.5 };
        let (loss, _) = ray_loss(&ray(true, Some(1.0)), &shown, SHARE, &config(1.0));
        // Differences 0, -0.5 and 1.6, the last beyond beta.
        assert!((loss.color - 0.25 / 3.0 * (0.125 + 1.1)).abs() < 1e-12);
        assert!((loss.mask - 0.1 * 0.25 * 2f64.ln()).abs() < 1e-12);
        assert!((loss.depth - 0.01 * 0.5 * 0.25).abs() < 1e-12);
        assert!((loss.part_entropy - 0.25 * 2f64.ln()).abs() < 1e-12, "even shares of two parts: ln 2");
        // Opacities beyond 1 are no error of the mask and have no slope there.
        let dense = Rendered { opacities: vec![0.8, 0.9], ..shown };
        let (loss, by) = ray_loss(&ray(true, None), &dense, SHARE, &config(0.0));
        assert!(loss.mask < 1e-4 && by.opacities == [0.0; 2] && by.distance == 0.0);
    }
}
