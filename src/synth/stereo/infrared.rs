//! Infrared images: ambient light and the projected pattern on the scene, exposed and read out in 8 bits.

use nalgebra::{Point3, Vector3};
use rand_core::Rng;
use rayon::prelude::*;

use super::pattern::DotPattern;
use crate::{Light, Scene};
use geometry::{Intrinsics, Pose};
use numeric::random;

/// Samples a side of a pixel, for the pattern.
const SAMPLES: usize = 2;
/// Farthest surface, meters. chosen: as for color
const FARTHEST_M: f64 = 20.0;
/// Gap at a surface where shadow rays start, meters. chosen: above rounding, below any gap
const SHADOW_MARGIN_M: f64 = 1e-4;
/// Irradiance in the middle of the brightest dot at 1 m, square to the beam, in units of the ambient light's.
/// chosen: dots stand out up to 3 m indoors
const DOT_AT_1_M: f64 = 4.0;
/// Radiance where nothing is seen, in units of a white surface in ambient light. chosen: a dark room beyond
const NOTHING: f64 = 0.03;
/// Exponent of a sheen's lobe (Blinn 1977): half height at 9 degrees. chosen: brushed metal
const SHEEN_EXPONENT: f64 = 60.0;
/// Strength of a sheen in its middle, in units of a white matt surface. chosen: saturates
const SHEEN: f64 = 12.0;
/// Mean gray level that the exposure aims at. chosen: as usual controls
const MEAN_GRAY: f64 = 60.0;
/// Gray level that most pixels stay below, and their share. chosen: few dots saturate
const BRIGHT_GRAY: f64 = 245.0;
const BRIGHT_SHARE: f64 = 0.99;
/// Pixels from one to the next that the exposure looks at.
const EXPOSURE_STEP: usize = 37;
/// Electrons a gray level.
/// chosen: plain paint at 1 m has about 0.1 pixels of error of disparity, as D435s have
const ELECTRONS_PER_GRAY: f64 = 3.0;
/// Standard deviation of the read noise at level 1, gray levels. chosen: below the shot noise
const READ_NOISE: f64 = 1.5;

/// A projector in a scene.
pub(super) struct Projector<'a> {
    /// Its dots.
    pub pattern: &'a DotPattern,
    /// Its pose.
    pub world_from_projector: Pose,
}

/// Radiance of the scene at each pixel of an imager, row-major; a white surface in ambient light has about 1.
/// One ray a pixel and one to the projector: samples of a pixel lie in the tangent plane of its hit.
pub(super) fn radiance_image(
    scene: &Scene,
    light: &Light,
    k: &Intrinsics,
    world_from_imager: &Pose,
    projector: &Projector,
) -> Vec<f32> {
    let projector_from_world = projector.world_from_projector.inverse();
    let lamp = Point3::from(projector.world_from_projector.translation.vector);
    let eye = Point3::from(world_from_imager.translation.vector);
    let pixels = (0..k.width * k.height).into_par_iter().with_min_len(k.width);
    let radiances = pixels.map(|i| {
        let at = [(i % k.width) as f64, (i / k.width) as f64];
        let ray = world_from_imager.rotation * k.ray_at(at[0], at[1]);
        let Some(sight) = scene.first_sight(&eye, &ray, FARTHEST_M) else { return NOTHING as f32 };
        let point = eye + ray * sight.at;
        let footprint_m = sight.at / k.fx;
        let surface = scene.infrared_of_sight(&sight, light, footprint_m);
        let to_lamp = lamp - point;
        let distance_m = to_lamp.norm();
        let cosine = to_lamp.dot(&sight.normal) / distance_m;
        let mut radiance = surface.ambient;
        if cosine > 0.0 && scene.is_clear(&point, &lamp, SHADOW_MARGIN_M) {
            let plane = sight.normal.dot(&(point - eye));
            let dots = samples_of_pixel(at).map(|[u, v]| {
                let ray = world_from_imager.rotation * k.ray_at(u, v);
                let point = eye + ray * (plane / sight.normal.dot(&ray));
                projector.pattern.light_along(&(projector_from_world * point).coords)
            });
            let dots = dots.iter().sum::<f64>() / dots.len() as f64;
            let irradiance = DOT_AT_1_M * dots / (distance_m * distance_m);
            let mut reflected = surface.albedo * cosine;
            if surface.sheen > 0.0 {
                let halfway: Vector3<f64> = to_lamp / distance_m - ray / ray.norm();
                let lobe = halfway.normalize().dot(&sight.normal).max(0.0).powf(SHEEN_EXPONENT);
                reflected += SHEEN * surface.sheen * lobe;
            }
            radiance += irradiance * reflected;
        }
        radiance as f32
    });
    radiances.collect()
}

/// Positions of the samples of a pixel.
fn samples_of_pixel([u, v]: [f64; 2]) -> [[f64; 2]; SAMPLES * SAMPLES] {
    let offset = |k: usize| (k as f64 + 0.5) / SAMPLES as f64 - 0.5;
    std::array::from_fn(|k| [u + offset(k % SAMPLES), v + offset(k / SAMPLES)])
}

/// Gray levels a unit of radiance for a view, by its left image.
pub(super) fn exposure_of(radiance: &[f32]) -> f64 {
    let mut seen: Vec<f32> = radiance.iter().step_by(EXPOSURE_STEP).copied().collect();
    seen.sort_by(f32::total_cmp);
    let mean = seen.iter().map(|r| f64::from(*r)).sum::<f64>() / seen.len().max(1) as f64;
    let bright = seen.get((BRIGHT_SHARE * seen.len() as f64) as usize).map_or(mean, |r| f64::from(*r));
    (MEAN_GRAY / mean.max(f64::MIN_POSITIVE)).min(BRIGHT_GRAY / bright.max(f64::MIN_POSITIVE))
}

/// Gray levels of an image with shot and read noise.
pub(super) fn gray_image(radiance: &[f32], exposure: f64, level: f64, rng: &mut impl Rng) -> Vec<u8> {
    let mut gray = Vec::with_capacity(radiance.len());
    for r in radiance {
        let mean = exposure * f64::from(*r);
        let sigma = level * (mean / ELECTRONS_PER_GRAY + READ_NOISE * READ_NOISE).sqrt();
        // Without noise the rounding error of 8 bits remains.
        let noise = if level > 0.0 { sigma * random::standard_normal(rng) } else { 0.0 };
        gray.push((mean + noise).round().clamp(0.0, 255.0) as u8);
    }
    gray
}
