//! Blur of colors by camera motion during the exposure.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::View;
use geometry::{Intrinsics, bilinear};

/// Exposure, seconds: about half of librealsense's color setting without automatic exposure, 156 steps of 0.1
/// ms. chosen: half of that default, rounded
const EXPOSURE_S: f64 = 0.008;
/// Most samples along a trace. chosen: fewer are faster, but show steps
const MOST_SAMPLES: f64 = 15.0;
/// Depth of pixels without a surface, meters. chosen: beyond any room
const FAR_M: f64 = 1e3;

/// Colors of a view, each averaged along the trace of its surface point while the shutter is open; `velocity`
/// is the camera's in its optical frame, m/s and rad/s.
pub(super) fn blurred_colors(
    level: f64,
    colors: &[Vector3<f64>],
    view: &View,
    k: &Intrinsics,
    velocity: &[Vector3<f64>; 2],
) -> Vec<Vector3<f64>> {
    let at = |i: usize| colors[i];
    let blurred = (0..colors.len()).into_par_iter().with_min_len(k.width).map(|i| {
        let [u, v] = [(i % k.width) as f64, (i / k.width) as f64];
        let trace = trace_px(view.depth_m[i], k, [u, v], velocity).map(|s| s * level * EXPOSURE_S);
        let samples = (trace[0].hypot(trace[1]).ceil() + 1.0).min(MOST_SAMPLES);
        // Centered on the exposure, so that blur does not shift the image.
        let shares = (0..samples as usize).map(|s| (s as f64 + 0.5) / samples - 0.5);
        let along = shares.map(|s| bilinear(at, k.width, k.height, u + s * trace[0], v + s * trace[1]));
        along.sum::<Vector3<f64>>() / samples
    });
    blurred.collect()
}

/// Image speed of the surface point at a pixel, pixels per second.
fn trace_px(depth_m: f64, k: &Intrinsics, [u, v]: [f64; 2], velocity: &[Vector3<f64>; 2]) -> [f64; 2] {
    let ray = k.ray_at(u, v);
    // For distant points, only the rotation matters.
    let z = if depth_m > 0.0 { depth_m } else { FAR_M };
    let [shift, turn] = velocity;
    let moves = -(shift / z + turn.cross(&ray));
    [k.fx * (moves.x - ray.x * moves.z), k.fy * (moves.y - ray.y * moves.z)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::test_view::wall;
    use geometry::Pose;

    #[test]
    fn a_trace_is_the_finite_difference_of_the_projection() {
        let k = Intrinsics { width: 64, height: 48, fx: 57.0, fy: 57.0, cx: 31.0, cy: 24.5 };
        let velocity = [Vector3::new(0.3, -0.2, 0.4), Vector3::new(0.1, 0.5, -0.3)];
        let at = [10.0, 40.0];
        let depth_m = 1.7;
        let step_s = 1e-6;
        let point = k.unproject(at[0], at[1], depth_m);
        let moved = Pose::new(velocity[0] * step_s, velocity[1] * step_s).inverse() * point;
        let (u, v) = k.project(&moved).unwrap();
        let [du, dv] = trace_px(depth_m, &k, at, &velocity);
        assert!(((u - at[0]) / step_s - du).abs() < 1e-3 && ((v - at[1]) / step_s - dv).abs() < 1e-3);
    }

    #[test]
    fn an_edge_is_smeared_over_the_length_of_the_trace() {
        let (view, k) = wall(2.0);
        let colors: Vec<_> = (0..view.depth_m.len())
            .map(|i| Vector3::repeat(f64::from(u8::from(i % k.width >= k.width / 2))))
            .collect();
        // Ten pixels in the 8 ms of the exposure.
        let velocity = [Vector3::new(10.0 / 0.008 * 2.0 / k.fx, 0.0, 0.0), Vector3::zeros()];
        let row = |level| {
            let blurred = blurred_colors(level, &colors, &view, &k, &velocity);
            let middle = k.height / 2 * k.width;
            blurred[middle..middle + k.width].iter().filter(|c| c.x > 0.01 && c.x < 0.99).count()
        };
        assert!((9..=11).contains(&row(1.0)) && (4..=6).contains(&row(0.5)), "{} {}", row(1.0), row(0.5));
        assert_eq!(blurred_colors(0.0, &colors, &view, &k, &velocity), colors);
    }
}
