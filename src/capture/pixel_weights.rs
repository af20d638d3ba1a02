//! Weights of depth pixels.

use nalgebra::Vector3;

use super::{NoiseConfig, RgbdFrame};

/// Half the window for slopes, pixels.
const R: usize = 2;

/// Weights of single pixels of a frame; see [`pixel_weights`].
pub(super) struct PixelWeights<'a> {
    frame: &'a RgbdFrame,
    noise: &'a NoiseConfig,
    /// Slopes of the viewing rays, by column and by row.
    slopes: [Vec<f64>; 2],
}

impl<'a> PixelWeights<'a> {
    pub fn of_frame(frame: &'a RgbdFrame, noise: &'a NoiseConfig) -> Self {
        let k = &frame.intrinsics;
        let slopes = [
            (0..k.width).map(|x| k.ray_at(x as f64, 0.0).x).collect(),
            (0..k.height).map(|y| k.ray_at(0.0, y as f64).y).collect(),
        ];
        Self { frame, noise, slopes }
    }

    fn depth_m(&self, x: usize, y: usize) -> f64 {
        f64::from(self.frame.depth_m[y * self.frame.intrinsics.width + x])
    }

    fn ray(&self, x: usize, y: usize) -> Vector3<f64> {
        Vector3::new(self.slopes[0][x], self.slopes[1][y], 1.0)
    }

    /// Weight of a pixel.
    pub fn weight_at(&self, x: usize, y: usize) -> f32 {
        let k = &self.frame.intrinsics;
        let noise = self.noise;
        if x < R || y < R || x + R >= k.width || y + R >= k.height {
            return 0.0;
        }
        let d = self.depth_m(x, y);
        let ends = [(x - R, y), (x + R, y), (x, y - R), (x, y + R)];
        let around = ends.map(|(x, y)| self.depth_m(x, y));
        // Beside a hole the slope is unknown.
        if d <= 0.0 || around.iter().any(|&n| n <= 0.0) {
            return 0.0;
        }
        let pixel_m = d * R as f64 / k.fx;
        // Largest depth change of a surface at the grazing limit over the window; more is an edge.
        // docs/method.md (2.9).
        let slope =
            pixel_m * (1.0 - noise.grazing_cosine * noise.grazing_cosine).sqrt() / noise.grazing_cosine;
        if around.iter().any(|n| (n - d).abs() > slope + noise.edge_sigmas * noise.sigma_m(d)) {
            return 0.0;
        }
        let at = |i: usize| self.ray(ends[i].0, ends[i].1) * around[i];
        let normal = (at(1) - at(0)).cross(&(at(3) - at(2)));
        let ray = self.ray(x, y);
        let lengths = (normal.norm_squared() * ray.norm_squared()).sqrt();
        let cosine = normal.dot(&ray).abs() / lengths.max(1e-12);
        if cosine >= noise.grazing_cosine { cosine as f32 } else { 0.0 }
    }
}

/// Weight of every pixel's depth in `[0, 1]`: 0 where it is unknown, at a depth edge or at a grazing angle;
/// else the cosine between ray and surface normal (central differences over 5 pixels).
#[must_use]
pub fn pixel_weights(frame: &RgbdFrame, noise: &NoiseConfig) -> Vec<f32> {
    let weights = PixelWeights::of_frame(frame, noise);
    let w = frame.intrinsics.width;
    let h = frame.intrinsics.height;
    (0..h).flat_map(|y| (0..w).map(move |x| (x, y))).map(|(x, y)| weights.weight_at(x, y)).collect()
}

/// The same for object pixels; 0 elsewhere.
#[must_use]
pub fn object_weights(frame: &RgbdFrame, noise: &NoiseConfig) -> Vec<f32> {
    let weights = PixelWeights::of_frame(frame, noise);
    let width = frame.intrinsics.width;
    (0..frame.depth_m.len())
        .map(|i| if frame.is_object(i) { weights.weight_at(i % width, i / width) } else { 0.0 })
        .collect()
}
