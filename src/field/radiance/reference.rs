//! The losses once more in double precision, sample by sample, as the equations read; for tests.

use nalgebra::{Point3, Vector3};

use super::loss::MASK_WEIGHT;
use super::ray_batch::{Ray, RayBatch};
use super::{HalfMotion, RadianceConfig};
use crate::reference::Reference;

/// Density and color of a part at a sample of a ray, through its half motion.
fn sample(
    field: &Reference<'_>,
    motion: Option<&HalfMotion>,
    config: &RadianceConfig,
    ray: &Ray,
    t: f64,
) -> (f64, Vec<f64>) {
    let (mut x, mut d): (Point3<f64>, Vector3<f64>) = (ray.origin + ray.direction * t, ray.direction);
    if let Some(motion) = motion {
        let half = if ray.state == 0 { motion.pose() } else { motion.pose().inverse() };
        (x, d) = (half * x, half * d);
    }
    let unit = x.coords.map(|c| 0.5 * (c / config.half_side + 1.0));
    if unit.iter().any(|u| !(0.0..=1.0).contains(u)) {
        return (0.0, vec![0.0; 3]);
    }
    let sigma = (field.geometry(unit.into())[0] - 1.0).exp();
    (sigma, field.color(unit.into(), d.into()))
}

fn smooth_l1(x: f64) -> f64 {
    if x.abs() < 1.0 { 0.5 * x * x } else { x.abs() - 0.5 }
}

fn cross_entropy(opacity: f64, object: bool) -> f64 {
    let o = opacity.clamp(1e-3, 1.0 - 1e-3);
    if object { -o.ln() } else { -(1.0 - o).ln() }
}

/// The mean over a state's rays of `each`, averaged over the states, with the depth term over readings.
fn mean(batch: &RayBatch, config: &RadianceConfig, each: impl Fn(usize, &Ray) -> (f64, f64)) -> f64 {
    let mut total = 0.0;
    for state in 0..2 {
        let mut sum = 0.0;
        let mut depth = 0.0;
        let mut rays = 0.0;
        let mut readings = 0.0;
        for (i, ray) in batch.rays.iter().enumerate().filter(|(_, r)| r.state == state) {
            let (loss, distance) = each(i, ray);
            sum += loss;
            rays += 1.0;
            if let Some(observed) = ray.distance {
                depth += (distance - observed).powi(2);
                readings += 1.0;
            }
        }
        total += 0.5 * (sum / rays + config.depth_weight * depth / readings);
    }
    total
}

/// The loss of any number of parts: products of transmittances, entropy of the shares.
pub(super) fn loss(
    fields: &[Reference<'_>],
    motions: &[HalfMotion],
    batch: &RayBatch,
    config: &RadianceConfig,
) -> f64 {
    mean(batch, config, |i, ray| {
        let mut color = [0.0; 3];
        let mut distance = 0.0;
        let mut transmittance = 1.0;
        let mut opacities = vec![0.0; fields.len()];
        for &t in &batch.distances[i * batch.samples..(i + 1) * batch.samples] {
            let mut through = 1.0;
            for (k, field) in fields.iter().enumerate() {
                let motion = k.checked_sub(1).map(|m| &motions[m]);
                let (sigma, c) = sample(field, motion, config, ray, t);
                let alpha = 1.0 - (-sigma * ray.step).exp();
                let w = alpha * transmittance;
                opacities[k] += w;
                distance += w * t;
                color.iter_mut().zip(&c).for_each(|(sum, c)| *sum += w * c);
                through *= 1.0 - alpha;
            }
            transmittance *= through;
        }
        let opacity: f64 = opacities.iter().sum();
        let rgb = (0..3).map(|c| smooth_l1(color[c] + (1.0 - opacity) - ray.color[c])).sum::<f64>() / 3.0;
        let entropy = if opacity > 0.01 {
            opacities.iter().map(|o| o / opacity).map(|p| -p * p.ln()).sum()
        } else {
            0.0
        };
        let mask = MASK_WEIGHT * cross_entropy(opacity, ray.object);
        (rgb + mask + config.part_entropy_weight * entropy, distance)
    })
}

/// The loss of a static and a mobile part, as PARIS and PARIS* write it.
pub(super) fn two_part_loss(
    [fixed, mobile]: [&Reference<'_>; 2],
    motion: &HalfMotion,
    batch: &RayBatch,
    config: &RadianceConfig,
) -> f64 {
    mean(batch, config, |i, ray| {
        let mut color = [0.0; 3];
        let mut o_s = 0.0;
        let mut o_m = 0.0;
        let mut distance = 0.0;
        let mut light = 1.0;
        for &t in &batch.distances[i * batch.samples..(i + 1) * batch.samples] {
            let (sigma_s, c_s) = sample(fixed, None, config, ray, t);
            let (sigma_m, c_m) = sample(mobile, Some(motion), config, ray, t);
            let alpha_s = 1.0 - (-sigma_s * ray.step).exp();
            let alpha_m = 1.0 - (-sigma_m * ray.step).exp();
            for c in 0..3 {
                color[c] += light * (alpha_s * c_s[c] + alpha_m * c_m[c]);
            }
            o_s += light * alpha_s;
            o_m += light * alpha_m;
            distance += light * (alpha_s + alpha_m) * t;
            light *= (1.0 - alpha_s) * (1.0 - alpha_m);
        }
        let opacity = o_s + o_m;
        let rgb = (0..3).map(|c| smooth_l1(color[c] + (1.0 - opacity) - ray.color[c])).sum::<f64>() / 3.0;
        let p = o_s / opacity;
        let binary = if opacity > 0.01 { -p * p.ln() - (1.0 - p) * (1.0 - p).ln() } else { 0.0 };
        let mask = MASK_WEIGHT * cross_entropy(opacity, ray.object);
        (rgb + mask + config.part_entropy_weight * binary, distance)
    })
}
