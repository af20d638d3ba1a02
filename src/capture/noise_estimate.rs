//! Estimate of the depth noise from a recording itself.
//!
//! The inverse depth of a plane is an affine function of the pixel. So the residual of an affine fit in a
//! small window is noise, wherever the surface is about flat; the median over many windows is robust to the
//! others.

use super::{
    NoiseConfig, RgbdFrame,
    window::{R, WindowPlane},
};
use numeric::statistics::median;

/// Approximate number of windows per frame. chosen: enough for a median, and cheap
const WINDOWS: f64 = 600.0;
/// Fewest windows for an estimate.
const MIN_WINDOWS: usize = 200;
/// Correction factor: noise of neighboring stereo pixels is correlated, and the fit absorbs the common part.
/// measured: on rendered stereo depth with known noise (docs/method.md 2.5)
const CORRELATION: f64 = 1.1;

/// Noise of the frames as a factor on the model's; `None` for too few flat windows. See docs/method.md (2.8).
#[must_use]
pub fn noise_factor<'a>(frames: impl Iterator<Item = &'a RgbdFrame>, noise: &NoiseConfig) -> Option<f64> {
    let factors: Vec<f64> = frames.flat_map(|f| window_factors(f, noise)).collect();
    if factors.len() < MIN_WINDOWS {
        return None;
    }
    Some(CORRELATION * median(factors)?)
}

impl NoiseConfig {
    /// The model with both terms multiplied by `factor`.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self { constant_m: self.constant_m * factor, quadratic_per_m: self.quadratic_per_m * factor, ..*self }
    }
}

fn window_factors(frame: &RgbdFrame, noise: &NoiseConfig) -> Vec<f64> {
    let w = frame.intrinsics.width;
    let h = frame.intrinsics.height;
    let stride = ((w * h) as f64 / WINDOWS).sqrt().ceil() as usize;
    let centers = (R..h.saturating_sub(R))
        .step_by(stride)
        .flat_map(|y| (R..w.saturating_sub(R)).step_by(stride).map(move |x| (x, y)));
    centers.filter_map(|(x, y)| window_factor(frame, noise, x, y)).collect()
}

fn window_factor(frame: &RgbdFrame, noise: &NoiseConfig, x: usize, y: usize) -> Option<f64> {
    let plane = WindowPlane::fit(frame, x, y)?;
    Some(plane.reading_sigma_m() / noise.sigma_m(plane.mean_depth_m))
}

#[cfg(test)]
mod tests {
    use rand_core::Rng;

    use super::*;
    use geometry::{Intrinsics, Pose};
    use numeric::random::stage_rng;

    /// A slanted wall with a step, with noise of so many times the default model.
    fn wall(factor: f64) -> RgbdFrame {
        let intrinsics = Intrinsics { width: 160, height: 120, fx: 150.0, fy: 150.0, cx: 80.0, cy: 60.0 };
        let noise = NoiseConfig::default();
        let mut rng = stage_rng(1, "wall", 0);
        let mut normal = || (0..12).map(|_| rng.next_u64() as f64 / u64::MAX as f64).sum::<f64>() - 6.0;
        let depth = |p: usize| {
            let ray = intrinsics.ray_at((p % 160) as f64, (p / 160) as f64);
            let d = 1.2 / (1.0 - 0.6 * ray.x - 0.3 * ray.y) + if p % 160 > 120 { 0.4 } else { 0.0 };
            (d, noise.sigma_m(d))
        };
        let depth_m = (0..160 * 120).map(|p| (depth(p).0 + factor * depth(p).1 * normal()) as f32).collect();
        RgbdFrame {
            id: String::new(),
            stamp_nanos: 0,
            intrinsics,
            world_from_camera: Pose::identity(),
            rgb: vec![[0; 3]; 160 * 120],
            depth_m,
            mask: None,
            readings: Vec::new(),
        }
    }

    #[test]
    fn the_noise_put_in_is_found() {
        for factor in [0.5, 1.0, 2.0] {
            let found = noise_factor([wall(factor)].iter(), &NoiseConfig::default()).unwrap();
            assert!((found / (CORRELATION * factor) - 1.0).abs() < 0.05, "{factor} {found}");
        }
    }

    #[test]
    fn without_flat_places_there_is_no_estimate() {
        let mut frame = wall(1.0);
        frame.depth_m.iter_mut().step_by(3).for_each(|d| *d = 0.0);
        assert_eq!(noise_factor([frame].iter(), &NoiseConfig::default()), None);
    }
}
