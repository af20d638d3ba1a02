//! A stereo depth camera with noise and quantization of disparity, occlusion shadows and holes.

use nalgebra::Point3;
use rand_core::Rng;
use rayon::prelude::*;

use super::{DepthErrors, Scene, View, edge::depth_step, smooth::smoothed_noise};
use geometry::{Intrinsics, Pose};
use numeric::random;

/// Error model of a stereo depth camera; the defaults are close to a D435 with default settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthCamera {
    /// Distance between the two imagers, meters; the second is at +x.
    pub baseline_m: f64,
    /// Standard deviation of the disparity, pixels.
    pub disparity_sigma_px: f64,
    /// Standard deviation of the Gaussian that smooths the noise, pixels.
    pub correlation_px: f64,
    /// Quantization step of disparity, pixels; 0 for none.
    pub disparity_step_px: f64,
    /// Cosine between ray and normal at which half of the readings are lost.
    pub grazing_cosine: f64,
    /// Share of readings lost at random.
    pub dropout: f64,
    /// Whether readings are missing where only one imager sees the surface, and at depth edges.
    pub shadows: bool,
    /// Standard deviation of the color noise, of 255.
    pub color_sigma: f64,
}

/// Least depth difference of neighboring pixels at an edge, share of the depth.
/// chosen: only a grazing surface has this difference over a pixel
const EDGE_SHARE: f64 = 0.025;
/// Width of the transition at grazing angles, in cosines. chosen: readings fail within a few degrees
const GRAZING_WIDTH: f64 = 0.03;
/// Distance from the surface at which shadow rays start, meters. chosen: above rounding, below any gap
const SHADOW_MARGIN_M: f64 = 1e-4;

impl Default for DepthCamera {
    fn default() -> Self {
        Self {
            baseline_m: 0.05,
            disparity_sigma_px: 0.073,
            correlation_px: 0.58,
            disparity_step_px: 1.0 / 32.0,
            grazing_cosine: 0.1,
            dropout: 0.004,
            shadows: true,
            color_sigma: 2.0,
        }
    }
}

impl DepthCamera {
    /// The default camera with noise, rates of missing readings and color noise scaled; 0 is a perfect
    /// sensor.
    pub fn with_scaled_noise(factor: f64) -> Self {
        let base = Self::default();
        // Quantization, shadows and grazing losses do not scale: they are switched off without noise.
        if factor == 0.0 {
            return Self {
                disparity_sigma_px: 0.0,
                disparity_step_px: 0.0,
                grazing_cosine: -1.0,
                dropout: 0.0,
                shadows: false,
                color_sigma: 0.0,
                ..base
            };
        }
        Self {
            disparity_sigma_px: base.disparity_sigma_px * factor,
            dropout: (base.dropout * factor).min(1.0),
            color_sigma: base.color_sigma * factor,
            ..base
        }
    }

    /// Depth readings of a view in millimeters, row-major, 0 = none; `errors` are added to this camera's own.
    pub fn depth_mm(
        &self,
        view: &View,
        scene: &Scene,
        k: &Intrinsics,
        world_from_camera: &Pose,
        errors: &DepthErrors,
        rng: &mut impl Rng,
    ) -> Vec<u16> {
        let pixels = k.width * k.height;
        // Drawn before the parallel loop, so the number of threads has no influence.
        let white: Vec<f64> = (0..pixels).map(|_| random::standard_normal(rng)).collect();
        let holes: Vec<[f64; 2]> =
            (0..pixels).map(|_| [random::unit_uniform(rng), random::unit_uniform(rng)]).collect();
        let noise = if self.disparity_sigma_px > 0.0 {
            smoothed_noise(&white, k.width, k.height, self.correlation_px)
        } else {
            white
        };
        let second_eye = world_from_camera * Point3::new(self.baseline_m, 0.0, 0.0);
        let readings = (0..pixels).into_par_iter().with_min_len(k.width).map(|i| {
            let depth_m = view.depth_m[i];
            let is_lost = view.lacquered[i] || holes[i][0] < self.dropout || errors.is_lost(i);
            if depth_m <= 0.0 || is_lost {
                return 0;
            }
            let between_m = errors.between_m(i);
            if between_m.is_none() {
                let fails =
                    1.0 / (1.0 + ((view.cosine[i] - self.grazing_cosine) / GRAZING_WIDTH * 4.0).exp());
                if holes[i][1] < fails && self.grazing_cosine >= 0.0 {
                    return 0;
                }
                if self.shadows && is_in_shadow(view, scene, k, world_from_camera, &second_eye, i) {
                    return 0;
                }
            }
            let read_m = between_m.unwrap_or(depth_m) * errors.factor(i);
            let error_px = self.disparity_sigma_px * noise[i];
            self.reading_mm(read_m, error_px, errors.disparity_px(i), k)
        });
        readings.collect()
    }

    /// Depth in millimeters from a disparity with errors; 0 if there is no valid reading.
    fn reading_mm(&self, depth_m: f64, noise_px: f64, error_px: f64, k: &Intrinsics) -> u16 {
        let focal_m = k.fx * self.baseline_m;
        // The disparity error is uniform over the range; the depth error grows with the square of the range.
        let mut disparity_px = focal_m / depth_m + noise_px + error_px;
        if self.disparity_step_px > 0.0 {
            disparity_px = (disparity_px / self.disparity_step_px).round() * self.disparity_step_px;
        }
        let mm = 1000.0 * focal_m / disparity_px;
        // Disparities at or below zero, and depths beyond 16 bits, give no reading.
        if mm > 0.0 && mm < f64::from(u16::MAX) { mm.round() as u16 } else { 0 }
    }

    /// sRGB colors of a view with the camera's noise, row-major.
    pub fn color_image(&self, view: &View, rng: &mut impl Rng) -> Vec<[u8; 3]> {
        let mut pixels = Vec::with_capacity(view.color.len());
        for color in &view.color {
            pixels.push([color.x, color.y, color.z].map(|linear| {
                let encoded = 255.0 * linear.clamp(0.0, 1.0).powf(1.0 / 2.2);
                (encoded + self.color_sigma * random::standard_normal(rng)).round().clamp(0.0, 255.0) as u8
            }));
        }
        pixels
    }
}

/// Whether a pixel's surface is hidden from the second imager, so that it has no disparity.
fn is_in_shadow(
    view: &View,
    scene: &Scene,
    k: &Intrinsics,
    world_from_camera: &Pose,
    second_eye: &Point3<f64>,
    i: usize,
) -> bool {
    let depth_m = view.depth_m[i];
    let seen = world_from_camera * k.unproject((i % k.width) as f64, (i / k.width) as f64, depth_m);
    depth_step(&view.depth_m, k, i).is_beyond(EDGE_SHARE * depth_m)
        || !scene.is_clear(&seen, second_eye, SHADOW_MARGIN_M)
}
