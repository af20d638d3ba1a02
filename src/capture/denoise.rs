//! Depth denoised by local planes. See docs/method.md (2.10).
//!
//! The inverse depth of a plane is an affine function of the pixel, and the disparity noise of a stereo
//! camera is the same in all pixels. So an affine function is fitted to inverse depth in growing windows
//! around each pixel. A window grows as long as the fit explains its readings and agrees with the smaller
//! windows within their confidence intervals (intersection of confidence intervals: Goldenshluger and
//! Nemirovski 1997; Katkovnik, Egiazarian and Astola 2006). Readings of other surfaces are left out, which
//! keeps edges in place.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::{NoiseConfig, RgbdFrame, median_over_object};
use common::stop::{Stop, Stopped};

/// Windows: half the side, and the step between used readings, pixels; and the number of readings equal to
/// one independent reading (stereo noise is correlated over about three pixels).
const WINDOWS: [FitWindow; 4] = [
    FitWindow { radius: 2, stride: 1, correlated: 6.25 },
    FitWindow { radius: 4, stride: 2, correlated: 2.25 },
    FitWindow { radius: 7, stride: 3, correlated: 1.0 },
    FitWindow { radius: 12, stride: 4, correlated: 1.0 },
];
/// Readings further than this from the plane of the next smaller window are of another surface, standard
/// deviations.
/// tuned: made and recorded objects (docs/method.md 16)
const GATE: f64 = 3.0;
/// The same in the smallest window, relative to the noisy reading at its center.
/// derived: 3 √2, as both readings have noise (docs/method.md 2.6)
const FIRST_GATE: f64 = 4.2;
/// Least share of a window's readings on one surface: in the smallest window, and in the others.
/// tuned: made and recorded objects (docs/method.md 16)
const MIN_SHARE: [f64; 2] = [0.5, 0.35];
/// Most readings that a depth counts for. chosen: bounded by the common errors of neighboring readings
const MAX_READINGS: f64 = 60.0;

#[derive(Clone, Copy)]
struct FitWindow {
    radius: i32,
    stride: i32,
    correlated: f64,
}

/// Plane of inverse depth around a pixel: value, slopes along u and v, and the variance of the value.
#[derive(Clone, Copy)]
struct InversePlane {
    inverse: Vector3<f64>,
    variance: f64,
}

/// Number of pixels of a row fitted together: a vector register of the oldest x86-64 and of aarch64.
const LANES: usize = 4;
/// Width of the empty border around the image, so that windows need no bounds checks.
const MARGIN: usize = WINDOWS[WINDOWS.len() - 1].radius as usize;

/// One value for each pixel fitted together.
type Lanes = [f32; LANES];

/// Inverse depth with an empty border.
struct InverseDepth {
    values: Vec<f32>,
    stride: usize,
}

impl InverseDepth {
    fn new(frame: &RgbdFrame) -> Self {
        let width = frame.intrinsics.width;
        let height = frame.intrinsics.height;
        // The lanes past the last pixel of a row may read beyond its end.
        let stride = width + 2 * MARGIN + LANES;
        let mut values = vec![0.0; stride * (height + 2 * MARGIN)];
        for (row, depths) in
            values.chunks_exact_mut(stride).skip(MARGIN).zip(frame.depth_m.chunks_exact(width))
        {
            // An inverse depth of 0, infinitely far, marks a missing reading.
            row[MARGIN..]
                .iter_mut()
                .zip(depths)
                .for_each(|(value, &d)| *value = if d > 0.0 { 1.0 / d } else { 0.0 });
        }
        Self { values, stride }
    }

    /// Index of the value of a pixel.
    fn index_of_pixel(&self, x: usize, y: usize) -> usize {
        (y + MARGIN) * self.stride + x + MARGIN
    }
}

/// Replaces the depth of object pixels by their local planes and sets the frame's `readings`. Depth with too
/// few neighbors on the same surface (flying pixels) becomes unknown.
///
/// # Errors
/// [`Stopped`].
pub fn denoise(frame: &mut RgbdFrame, noise: &NoiseConfig, stop: &Stop) -> Result<(), Stopped> {
    let inverse = InverseDepth::new(frame);
    let rows = (0..frame.intrinsics.height).into_par_iter();
    let cleaned: Vec<Vec<(f32, f32)>> = rows
        .map(|y| {
            stop.check()?;
            Ok(denoised_row(frame, &inverse, noise, y))
        })
        .collect::<Result<_, Stopped>>()?;
    (frame.depth_m, frame.readings) = cleaned.into_iter().flatten().unzip();
    Ok(())
}

/// Depth, meters, and number of readings of each pixel in a row.
fn denoised_row(frame: &RgbdFrame, inverse: &InverseDepth, noise: &NoiseConfig, y: usize) -> Vec<(f32, f32)> {
    let width = frame.intrinsics.width;
    let mut row: Vec<(f32, f32)> =
        frame.depth_m[y * width..(y + 1) * width].iter().map(|&d| (d, 1.0)).collect();
    for (block, cleaned) in row.chunks_mut(LANES).enumerate() {
        let first = block * LANES;
        let sigmas: [Option<f64>; LANES] = std::array::from_fn(|lane| {
            let depth_m = f64::from(cleaned.get(lane)?.0);
            (depth_m > 0.0 && frame.is_object(y * width + first + lane))
                .then(|| noise.sigma_m(depth_m) / depth_m.powi(2))
        });
        let planes = local_planes(inverse, inverse.index_of_pixel(first, y), &sigmas);
        for ((cleaned, sigma), plane) in cleaned.iter_mut().zip(sigmas).zip(planes) {
            let Some(sigma) = sigma else { continue };
            *cleaned = match plane {
                Some(p) if p.inverse[0] > 0.0 => (
                    (1.0 / p.inverse[0]) as f32,
                    // docs/method.md (2.11): the number of readings with the variance of the plane.
                    (sigma * sigma / p.variance).clamp(1.0, MAX_READINGS) as f32,
                ),
                _ => (0.0, 0.0),
            };
        }
    }
    row
}

/// Distance on the object over which errors of denoised depth are correlated, meters: half a side of the
/// largest window at the median depth; 0 for raw depth.
#[must_use]
pub fn smoothing_m(frames: &[RgbdFrame]) -> f64 {
    let denoised = frames.iter().filter(|f| !f.readings.is_empty());
    let radius = f64::from(WINDOWS[WINDOWS.len() - 1].radius);
    median_over_object(denoised, |f, i| radius * f64::from(f.depth_m[i]) / f.intrinsics.fx).unwrap_or(0.0)
}

/// The plane of the largest accepted window for each pixel from `first` on.
fn local_planes(
    inverse: &InverseDepth,
    first: usize,
    sigmas: &[Option<f64>; LANES],
) -> [Option<InversePlane>; LANES] {
    let mut best = [None; LANES];
    let mut intervals = [[f64::NEG_INFINITY, f64::INFINITY]; LANES];
    let mut growing = *sigmas;
    for window in &WINDOWS {
        if growing.iter().all(Option::is_none) {
            break;
        }
        // The first window starts with a constant, each later one with the previous plane, so that the gate
        // follows the slope.
        let starts: [Vector3<f64>; LANES] = std::array::from_fn(|lane| match best[lane] {
            Some(InversePlane { inverse, .. }) => inverse,
            None => Vector3::new(f64::from(inverse.values[first + lane]), 0.0, 0.0),
        });
        let is_first = window.radius == WINDOWS[0].radius;
        // A difference between two readings has twice the variance of a reading: the first gate is wider by
        // the root of two.
        let gate = if is_first { FIRST_GATE } else { GATE };
        let sums =
            window_sums(inverse, first, window, &starts, &growing.map(|s| (gate * s.unwrap_or(0.0)) as f32));
        for lane in 0..LANES {
            let Some(sigma) = growing[lane] else { continue };
            let plane = sums.fitted_plane(lane, sigma, window, &starts[lane], is_first);
            // The intersection of docs/method.md (2.10). Where it is empty, the window has left the plane of
            // the surface.
            let interval = plane.map(|p| {
                let half = p.variance.sqrt();
                [intervals[lane][0].max(p.inverse[0] - half), intervals[lane][1].min(p.inverse[0] + half)]
            });
            match interval {
                Some(interval) if interval[0] <= interval[1] => {
                    (best[lane], intervals[lane]) = (plane, interval)
                }
                _ => growing[lane] = None,
            }
        }
    }
    best
}

/// Sums over a window's readings within the gate.
#[derive(Default)]
struct WindowSums {
    /// Of 1, u, v, uu, uv, vv.
    moments: [Lanes; 6],
    /// Of the residual against `start` times 1, u, v.
    residuals: [Lanes; 3],
    /// Of the squared residuals.
    squares: Lanes,
}

/// The sums of neighboring pixels relative to their planes so far, `starts`.
fn window_sums(
    inverse: &InverseDepth,
    first: usize,
    window: &FitWindow,
    starts: &[Vector3<f64>; LANES],
    gates: &Lanes,
) -> WindowSums {
    let start = [0, 1, 2].map(|k| starts.map(|s| s[k] as f32));
    let mut sums = WindowSums::default();
    for dv in reading_offsets(window) {
        let row = first.wrapping_add_signed(dv as isize * inverse.stride as isize);
        let v = dv as f32;
        // Of 1, u, uu; of the residual times 1, u.
        let mut n = Lanes::default();
        let mut nu = Lanes::default();
        let mut nuu = Lanes::default();
        let mut r = Lanes::default();
        let mut ru = Lanes::default();
        for du in reading_offsets(window) {
            let at = row.wrapping_add_signed(du as isize);
            let readings = &inverse.values[at..at + LANES];
            let u = du as f32;
            for lane in 0..LANES {
                // Sums of residuals, not of values: small numbers are more accurate in single precision.
                let residual = readings[lane] - (start[0][lane] + start[2][lane] * v + start[1][lane] * u);
                // Branch-free, so that the compiler can vectorize it.
                let near = (readings[lane] > 0.0) & (residual.abs() < gates[lane]);
                let (one, residual) = if near { (1.0, residual) } else { (0.0, 0.0) };
                n[lane] += one;
                nu[lane] += one * u;
                nuu[lane] += one * u * u;
                r[lane] += residual;
                ru[lane] += residual * u;
                sums.squares[lane] += residual * residual;
            }
        }
        for lane in 0..LANES {
            // All readings of a row share v, so its moments are products.
            let moments = [n[lane], nu[lane], v * n[lane], nuu[lane], v * nu[lane], v * v * n[lane]];
            (0..6).for_each(|k| sums.moments[k][lane] += moments[k]);
            let residuals = [r[lane], ru[lane], v * r[lane]];
            (0..3).for_each(|k| sums.residuals[k][lane] += residuals[k]);
        }
    }
    sums
}

/// Offsets of the used readings of a window, pixels.
fn reading_offsets(window: &FitWindow) -> impl Iterator<Item = i32> {
    let half = window.radius / window.stride;
    let stride = window.stride;
    (-half..=half).map(move |k| k * stride)
}

impl WindowSums {
    /// Least-squares plane of one pixel's readings; `None` if they are too few or do not lie on one.
    fn fitted_plane(
        &self,
        lane: usize,
        sigma: f64,
        window: &FitWindow,
        start: &Vector3<f64>,
        first: bool,
    ) -> Option<InversePlane> {
        let s = self.moments.map(|m| f64::from(m[lane]));
        let b = Vector3::from(self.residuals.map(|r| f64::from(r[lane])));
        let side = reading_offsets(window).count();
        if s[0] < MIN_SHARE[usize::from(!first)] * (side * side) as f64 {
            return None;
        }
        let covariance = Matrix3::new(s[0], s[1], s[2], s[1], s[3], s[4], s[2], s[4], s[5]).try_inverse()?;
        let change = covariance * b;
        // The reduction of the squares follows from the fit, without a second pass over the window.
        let misfit = (f64::from(self.squares[lane]) - change.dot(&b)) / (s[0] - 3.0) / (sigma * sigma);
        // The mean of ν squared residuals has the variance 2 / ν; correlated readings count as one.
        let freedom = (s[0] / window.correlated - 3.0).max(1.0);
        if !first && misfit > 1.0 + (2.0 / freedom).sqrt() {
            return None;
        }
        Some(InversePlane {
            inverse: start + change,
            variance: covariance[(0, 0)] * window.correlated * sigma * sigma,
        })
    }
}

#[cfg(test)]
mod tests {
    use rand_core::{Rng, SeedableRng};

    use super::*;
    use geometry::{Intrinsics, Pose};

    const NOISE: NoiseConfig =
        NoiseConfig { constant_m: 0.0, quadratic_per_m: 0.003, edge_sigmas: 6.0, grazing_cosine: 0.15 };

    /// Depth by pixel, with disparity noise blurred over 2x2 pixels.
    fn noisy(depth: impl Fn(f64, f64) -> f64) -> (RgbdFrame, Vec<f64>) {
        let intrinsics = Intrinsics { width: 96, height: 72, fx: 100.0, fy: 100.0, cx: 47.5, cy: 35.5 };
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(3);
        let mut normal =
            || (0..12).map(|_| f64::from(rng.next_u32()) / f64::from(u32::MAX)).sum::<f64>() - 6.0;
        let white: Vec<f64> = (0..97 * 73).map(|_| normal()).collect();
        let at = |x: usize, y: usize| {
            0.5 * (white[y * 97 + x]
                + white[y * 97 + x + 1]
                + white[(y + 1) * 97 + x]
                + white[(y + 1) * 97 + x + 1])
        };
        let truth: Vec<f64> = (0..96 * 72).map(|i| depth((i % 96) as f64, (i / 96) as f64)).collect();
        let depth_m = truth
            .iter()
            .enumerate()
            .map(|(i, d)| (1.0 / (1.0 / d + 0.003 * at(i % 96, i / 96))) as f32)
            .collect();
        let rgb = vec![[0; 3]; 96 * 72];
        let world_from_camera = Pose::identity();
        let id = String::new();
        (
            RgbdFrame {
                id,
                stamp_nanos: 0,
                intrinsics,
                world_from_camera,
                rgb,
                depth_m,
                mask: None,
                readings: Vec::new(),
            },
            truth,
        )
    }

    fn rms(frame: &RgbdFrame, truth: &[f64], inside: impl Fn(usize, usize) -> bool) -> f64 {
        let pixels: Vec<usize> =
            (0..truth.len()).filter(|i| frame.depth_m[*i] > 0.0 && inside(i % 96, i / 96)).collect();
        (pixels.iter().map(|&i| (f64::from(frame.depth_m[i]) - truth[i]).powi(2)).sum::<f64>()
            / pixels.len() as f64)
            .sqrt()
    }

    #[test]
    fn a_slanted_plane_loses_most_of_its_noise_and_the_rest_is_as_reported() {
        let (mut frame, truth) = noisy(|x, y| 1.0 / (0.5 + 0.0008 * x - 0.0005 * y));
        let before = rms(&frame, &truth, |_, _| true);
        denoise(&mut frame, &NOISE, &Stop::never()).unwrap();
        let after = rms(&frame, &truth, |_, _| true);
        assert!(after < 0.35 * before, "{before} {after}");
        let kept = (0..truth.len()).filter(|&i| frame.depth_m[i] > 0.0);
        let z: Vec<f64> =
            kept.map(|i| (f64::from(frame.depth_m[i]) - truth[i]) / frame.sigma_m(i, &NOISE)).collect();
        let spread = (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt();
        assert!((0.5..1.6).contains(&spread), "{spread}");
    }

    #[test]
    fn a_step_stays_where_it_is() {
        let (mut frame, truth) = noisy(|x, _| if x < 48.0 { 1.0 } else { 1.05 });
        denoise(&mut frame, &NOISE, &Stop::never()).unwrap();
        assert!(rms(&frame, &truth, |x, _| (44..52).contains(&x)) < 0.006);
    }

    #[test]
    fn a_flying_pixel_becomes_unknown() {
        let (mut frame, _) = noisy(|_, _| 1.0);
        frame.depth_m[30 * 96 + 40] = 1.5;
        denoise(&mut frame, &NOISE, &Stop::never()).unwrap();
        assert_eq!(frame.depth_m[30 * 96 + 40], 0.0);
        assert!(frame.depth_m[30 * 96 + 41] > 0.0);
    }

    #[test]
    fn curved_surfaces_keep_their_shape() {
        let dome = |x: f64, y: f64| {
            1.0 - (0.09 - ((x - 47.5) / 200.0).powi(2) - ((y - 35.5) / 200.0).powi(2)).max(0.0).sqrt()
        };
        let (mut frame, truth) = noisy(dome);
        let before = rms(&frame, &truth, |_, _| true);
        denoise(&mut frame, &NOISE, &Stop::never()).unwrap();
        assert!(rms(&frame, &truth, |_, _| true) < 0.6 * before);
    }
}
