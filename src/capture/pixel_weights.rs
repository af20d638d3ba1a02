//! How much the depth of a pixel counts.

use nalgebra::Vector3;

use super::{NoiseConfig, RgbdFrame};

/// Weight of every pixel's depth in `[0, 1]`: 0 where it is unknown, at a depth edge or seen at a grazing
/// angle, else the cosine between ray and surface normal (from central differences over a 5-pixel window).
#[must_use]
pub fn pixel_weights(frame: &RgbdFrame, noise: &NoiseConfig) -> Vec<f32> {
    let (w, h) = (frame.intrinsics.width, frame.intrinsics.height);
    let depth = |x: usize, y: usize| f64::from(frame.depth_m[y * w + x]);
    let k = &frame.intrinsics;
    // Slopes of the rays, by column and by row.
    let slopes = [
        (0..w).map(|x| k.ray(x as f64, 0.0).x).collect::<Vec<_>>(),
        (0..h).map(|y| k.ray(0.0, y as f64).y).collect(),
    ];
    let ray = |x: usize, y: usize| Vector3::new(slopes[0][x], slopes[1][y], 1.0);
    let mut weights = vec![0.0; w * h];
    const R: usize = 2;
    for y in R..h.saturating_sub(R) {
        for x in R..w.saturating_sub(R) {
            let d = depth(x, y);
            let around = [depth(x - R, y), depth(x + R, y), depth(x, y - R), depth(x, y + R)];
            // Beside a hole the slope is not known.
            if d <= 0.0 || around.iter().any(|&n| n <= 0.0) {
                continue;
            }
            let pixel_m = d * R as f64 / frame.intrinsics.fx;
            // What a surface at the grazing limit falls off by over the window; more is an edge.
            let slope =
                pixel_m * (1.0 - noise.grazing_cosine * noise.grazing_cosine).sqrt() / noise.grazing_cosine;
            if around.iter().any(|n| (n - d).abs() > slope + noise.edge_sigmas * noise.sigma_m(d)) {
                continue;
            }
            let at = |x: usize, y: usize| ray(x, y) * depth(x, y);
            let across = at(x + R, y) - at(x - R, y);
            let down = at(x, y + R) - at(x, y - R);
            let (normal, ray) = (across.cross(&down), ray(x, y));
            let lengths = (normal.norm_squared() * ray.norm_squared()).sqrt();
            let cosine = normal.dot(&ray).abs() / lengths.max(1e-12);
            if cosine >= noise.grazing_cosine {
                weights[y * w + x] = cosine as f32;
            }
        }
    }
    weights
}
