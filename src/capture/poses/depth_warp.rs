//! Systematic depth errors of a sensor, per pixel: a smooth share of the range.
//!
//! True depth is a reading times `1 + c(u, v)`, where c is a cubic B-spline on a coarse grid over the image
//! (Basso, Menegatti and Pretto 2018 call its map the undistortion map; Teichman, Miller and Thrun 2013 found
//! it without a target). Its mean over the image is the error of the sensor's scale.
//! See docs/method.md (2.20).

use nalgebra::{DMatrix, DVector, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::RgbdFrame;
use geometry::Intrinsics;

/// Spline intervals along the image width.
/// chosen: about the correlation length of the errors
const INTERVALS: f64 = 8.0;
/// Spline coefficients per axis that affect a pixel.
pub(crate) const ORDER: usize = 4;
/// Correlation length of the errors, share of the image width: 90 pixels of 640 (residual errors of lens and
/// rectification: Teichman, Miller and Thrun 2013). chosen: between the values of these papers
const CORRELATED: f64 = 0.14;
/// Independent share of the coefficients' variance; it keeps the prior invertible.
/// chosen: small against the correlated part
const OWN: f64 = 1e-4;

/// The smooth depth error of a sensor: a spline over the image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DepthWarp {
    /// Distance of neighboring coefficients, pixels; the first lies one step outside the image.
    pub step_px: f64,
    /// Number of coefficients in a row, and of rows.
    pub shape: [usize; 2],
    /// Coefficients row by row: shares of the range, positive where readings are too short.
    pub values: Vec<f64>,
}

/// The coefficients that affect a pixel, and their weights.
#[derive(Clone, Copy)]
pub(crate) struct SplineSupport {
    /// Index of the first one; the others follow in four rows of four.
    first: usize,
    columns: usize,
    weights: [[f64; ORDER]; 2],
}

impl SplineSupport {
    /// For each of the four rows, the index of the first coefficient and the weights.
    pub fn weighted_rows(&self) -> [(usize, [f64; ORDER]); ORDER] {
        std::array::from_fn(|row| {
            (self.first + row * self.columns, self.weights[0].map(|across| across * self.weights[1][row]))
        })
    }

    /// Indices and weights of the coefficients.
    pub fn iter(&self) -> impl Iterator<Item = (usize, f64)> {
        self.weighted_rows().into_iter().flat_map(|(first, weights)| {
            weights.into_iter().enumerate().map(move |(i, weight)| (first + i, weight))
        })
    }
}

impl DepthWarp {
    /// No error, for images of this size.
    pub fn without_errors(intrinsics: &Intrinsics) -> Self {
        let step_px = intrinsics.width as f64 / INTERVALS;
        let shape = [intrinsics.width, intrinsics.height]
            .map(|side| ((side - 1) as f64 / step_px).ceil().max(1.0) as usize + ORDER - 1);
        Self { step_px, shape, values: vec![0.0; shape[0] * shape[1]] }
    }

    /// Index of the first of four coefficients along an axis of `count`, and their weights.
    fn interval_weights(&self, pixel: f64, count: usize) -> (usize, [f64; ORDER]) {
        let at = (pixel / self.step_px).max(0.0);
        // The last pixel may lie at the end of the last interval.
        let cell = (at as usize).min(count - ORDER);
        (cell, cubic_spline_weights(at - cell as f64))
    }

    /// The coefficients that affect a pixel, with their weights.
    pub(crate) fn support_at(&self, [u, v]: [f64; 2]) -> SplineSupport {
        let (column, across) = self.interval_weights(u, self.shape[0]);
        let (row, down) = self.interval_weights(v, self.shape[1]);
        SplineSupport { first: row * self.shape[0] + column, columns: self.shape[0], weights: [across, down] }
    }

    /// Error at a pixel, share of the range; positive where readings are too short.
    #[must_use]
    pub fn relative_error_at(&self, pixel: [f64; 2]) -> f64 {
        self.support_at(pixel).iter().map(|(k, weight)| weight * self.values[k]).sum()
    }

    /// Slopes of the error along the image, 1/pixel.
    pub(crate) fn slopes_at(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        /// derived: half a pixel to either side
        const STEP: f64 = 0.5;
        // The spline varies over tens of pixels, so a difference over one pixel gives its slope.
        [
            self.relative_error_at([u + STEP, v + 0.0]) - self.relative_error_at([u - STEP, v + 0.0]),
            self.relative_error_at([u + 0.0, v + STEP]) - self.relative_error_at([u + 0.0, v - STEP]),
        ]
    }

    /// Weight of each coefficient in the mean over the image.
    pub(crate) fn mean_weights(&self, intrinsics: &Intrinsics) -> DVector<f64> {
        let mut mean = DVector::zeros(self.values.len());
        let mut count = 0.0;
        for pixel in some_pixels(intrinsics) {
            self.support_at(pixel).iter().for_each(|(k, weight)| mean[k] += weight);
            count += 1.0;
        }
        mean / count
    }

    /// Root mean square deviation from the mean over the image.
    pub(crate) fn spread_about_mean(&self, intrinsics: &Intrinsics) -> f64 {
        let all: Vec<f64> = some_pixels(intrinsics).map(|pixel| self.relative_error_at(pixel)).collect();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        (all.iter().map(|c| (c - mean).powi(2)).sum::<f64>() / all.len() as f64).sqrt()
    }

    /// Prior covariance of the coefficients, for correlated errors of unit size.
    pub(crate) fn smooth_covariance(&self) -> DMatrix<f64> {
        let width = self.step_px * INTERVALS;
        let place =
            |k: usize| [k % self.shape[0], k / self.shape[0]].map(|i| i as f64 * self.step_px / width);
        DMatrix::from_fn(self.values.len(), self.values.len(), |a, b| {
            let p = place(a);
            let q = place(b);
            let squared = (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2);
            (-squared / (2.0 * CORRELATED * CORRELATED)).exp() + if a == b { OWN } else { 0.0 }
        })
    }

    /// Corrects all depth readings of the frames.
    pub(crate) fn correct_frames<'a>(&self, frames: impl Iterator<Item = &'a mut RgbdFrame>) {
        let mut factors: Vec<f32> = Vec::new();
        for frame in frames {
            let width = frame.intrinsics.width;
            let height = frame.intrinsics.height;
            // All frames share one camera, and so one table.
            if factors.is_empty() {
                let rows = (0..height).into_par_iter();
                let pixels = rows.flat_map_iter(|v| (0..width).map(move |u| [u as f64, v as f64]));
                factors = pixels.map(|pixel| (1.0 + self.relative_error_at(pixel)) as f32).collect();
            }
            frame.depth_m.iter_mut().zip(&factors).for_each(|(depth, factor)| *depth *= factor);
        }
    }
}

/// Sampled pixels, row by row: enough for means of a spline that varies over tens of pixels.
fn some_pixels(intrinsics: &Intrinsics) -> impl Iterator<Item = [f64; 2]> {
    const EVERY: usize = 8;
    let width = intrinsics.width;
    let height = intrinsics.height;
    (0..height).step_by(EVERY).flat_map(move |v| (0..width).step_by(EVERY).map(move |u| [u as f64, v as f64]))
}

/// The error at a pixel and its slopes.
#[derive(Clone, Copy)]
pub(crate) struct Bend {
    /// Share of the range, positive where readings are too short.
    share: f64,
    /// Slopes along the image, 1/pixel.
    slopes: [f64; 2],
}

impl Bend {
    /// The warp's error at a pixel.
    pub fn of_warp_at(warp: &DepthWarp, pixel: [f64; 2]) -> Self {
        Self { share: warp.relative_error_at(pixel), slopes: warp.slopes_at(pixel) }
    }

    /// The corrected inverse depth and slopes of a plane.
    pub fn corrected_plane(&self, plane: Vector3<f64>) -> Vector3<f64> {
        let factor = 1.0 + self.share;
        let slopes = self.slopes;
        // The inverse depth is divided by 1 + c; its slopes follow by the quotient rule.
        let bent = plane.x / (factor * factor);
        Vector3::new(
            plane.x / factor,
            plane.y / factor - bent * slopes[0],
            plane.z / factor - bent * slopes[1],
        )
    }
}

/// Weights of the uniform cubic B-spline at a position in its interval.
fn cubic_spline_weights(t: f64) -> [f64; ORDER] {
    let s = 1.0 - t;
    [
        s.powi(3) / 6.0,
        (3.0 * t.powi(3) - 6.0 * t * t + 4.0) / 6.0,
        (3.0 * s.powi(3) - 6.0 * s * s + 4.0) / 6.0,
        t.powi(3) / 6.0,
    ]
}
