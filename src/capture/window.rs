//! Planes in small windows of a depth image.
//!
//! The inverse depth of a plane is an affine function of the pixel.

use nalgebra::{Matrix3, Vector3};

use super::RgbdFrame;

/// Windows have `2 R + 1` pixels a side.
pub(super) const R: usize = 3;
/// Readings of a window.
pub(super) const READINGS: usize = (2 * R + 1) * (2 * R + 1);
/// Fitted values of a window.
const UNKNOWNS: usize = 3;
/// Least share of valid readings in a window with holes. chosen: well over half
const LEAST_SHARE: f64 = 0.6;
/// A window with a larger range of depths, relative to their mean, shows an edge.
/// chosen: only a grazing surface has this range over a window
const MAX_RANGE: f64 = 0.1;

/// Plane of inverse depth fitted to the window around a pixel by least squares.
#[derive(Clone, Copy, Debug)]
pub(super) struct WindowPlane {
    /// Inverse depth in the middle, 1/meter.
    pub inverse: f64,
    /// Its slopes along u and v, 1/(meter pixel).
    pub slopes: [f64; 2],
    /// Variance of a reading about the plane, 1/square meter.
    pub variance: f64,
    /// Mean depth, meters.
    pub mean_depth_m: f64,
}

impl WindowPlane {
    /// The plane around a pixel at least [`R`] from the border; `None` where a reading is missing or the
    /// window shows an edge.
    pub fn fit(frame: &RgbdFrame, x: usize, y: usize) -> Option<Self> {
        let side = 2 * R + 1;
        let count = READINGS as f64;
        let mut inverse = [0.0; READINGS];
        let mut sum = 0.0;
        let mut least = f64::INFINITY;
        let mut most = 0.0f64;
        for (i, value) in inverse.iter_mut().enumerate() {
            let d = f64::from(frame.depth_m[(y + i / side - R) * frame.intrinsics.width + x + i % side - R]);
            if d <= 0.0 {
                return None;
            }
            (sum, least, most) = (sum + d, least.min(d), most.max(d));
            *value = 1.0 / d;
        }
        let mean_depth_m = sum / count;
        // An edge would tilt the plane and look like noise.
        if most - least > MAX_RANGE * mean_depth_m {
            return None;
        }
        // The window is symmetric, so slopes and mean are independent.
        let place = |i: usize| ((i % side) as f64 - R as f64, (i / side) as f64 - R as f64);
        let spread: f64 = (0..inverse.len()).map(|i| place(i).0.powi(2)).sum();
        let mean = inverse.iter().sum::<f64>() / count;
        let slope_x = inverse.iter().enumerate().map(|(i, v)| place(i).0 * v).sum::<f64>() / spread;
        let slope_y = inverse.iter().enumerate().map(|(i, v)| place(i).1 * v).sum::<f64>() / spread;
        let residuals =
            inverse.iter().enumerate().map(|(i, v)| v - mean - slope_x * place(i).0 - slope_y * place(i).1);
        // docs/method.md (2.7).
        let variance = residuals.map(|r| r.powi(2)).sum::<f64>() / (count - UNKNOWNS as f64);
        Some(Self { inverse: mean, slopes: [slope_x, slope_y], variance, mean_depth_m })
    }

    /// The same with some readings missing, as in the speckled depth of real sensors.
    pub fn fit_with_holes(frame: &RgbdFrame, x: usize, y: usize) -> Option<Self> {
        if let Some(whole) = Self::fit(frame, x, y) {
            return Some(whole);
        }
        let side = 2 * R + 1;
        let mut places = [Vector3::zeros(); READINGS];
        let mut depths_m = [0.0; READINGS];
        let mut count = 0;
        for i in 0..READINGS {
            let u = i % side;
            let v = i / side;
            let depth_m = f64::from(frame.depth_m[(y + v - R) * frame.intrinsics.width + x + u - R]);
            if depth_m > 0.0 {
                places[count] = Vector3::new(1.0, u as f64 - R as f64, v as f64 - R as f64);
                depths_m[count] = depth_m;
                count += 1;
            }
        }
        let readings = || places[..count].iter().zip(&depths_m[..count]);
        let count = count as f64;
        if count < LEAST_SHARE * READINGS as f64 {
            return None;
        }
        let mean_depth_m = readings().map(|(_, d)| d).sum::<f64>() / count;
        let most = readings().map(|(_, d)| *d).fold(0.0, f64::max);
        let least = readings().map(|(_, d)| *d).fold(f64::INFINITY, f64::min);
        if most - least > MAX_RANGE * mean_depth_m {
            return None;
        }
        // With holes the window is not symmetric: slopes and mean are solved for jointly.
        let moments: Matrix3<f64> = readings().map(|(at, _)| at * at.transpose()).sum();
        let right: Vector3<f64> = readings().map(|(at, d)| at / *d).sum();
        let plane = moments.cholesky()?.solve(&right);
        let squares = readings().map(|(at, d)| (1.0 / d - at.dot(&plane)).powi(2)).sum::<f64>();
        let variance = squares / (count - UNKNOWNS as f64);
        Some(Self { inverse: plane.x, slopes: [plane.y, plane.z], variance, mean_depth_m })
    }

    /// Standard deviation of a reading, meters: d(depth) = depth^2 d(1/depth).
    pub fn reading_sigma_m(&self) -> f64 {
        self.variance.sqrt() * self.mean_depth_m * self.mean_depth_m
    }
}
