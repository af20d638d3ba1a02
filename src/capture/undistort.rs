//! Removal of lens distortion: images are resampled into an ideal pinhole camera with the same camera matrix.
//! See docs/method.md (2.3).
//!
//! The models are those of `sensor_msgs/CameraInfo` (OpenCV): with `x, y` the ideal image plane coordinates
//! and `r2 = x^2 + y^2`, the lens shows the point at
//!
//! ```text
//! radial = (1 + k1 r2 + k2 r2^2 + k3 r2^3) / (1 + k4 r2 + k5 r2^2 + k6 r2^3)
//! x' = x radial + 2 p1 x y + p2 (r2 + 2 x^2)
//! y' = y radial + p1 (r2 + 2 y^2) + 2 p2 x y
//! ```
//!
//! z-depth is the same in both cameras, since they share their frame.

use nalgebra::Vector3;

use geometry::{Intrinsics, bilinear};

/// Lens model; all zero is a pinhole.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distortion {
    /// Radial numerator k1, k2, k3.
    pub radial: [f64; 3],
    /// Radial denominator k4, k5, k6.
    pub rational: [f64; 3],
    /// Tangential p1, p2.
    pub tangential: [f64; 2],
}

/// Why a lens model cannot be used, as the end of a sentence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LensFault {
    /// A coefficient is not finite.
    #[error("has coefficients that are not finite")]
    NotFinite,
    /// It has prism or tilt terms, which are not supported.
    #[error("has thin prism or tilt terms")]
    PrismOrTilt,
    /// A number of coefficients that the model does not have.
    #[error("has {0} coefficients")]
    Count(usize),
    /// The model is unknown.
    #[error("is not supported")]
    Unknown,
}

impl Distortion {
    /// The distortion by model name and coefficients of a camera_info.
    ///
    /// # Errors
    /// Another model, a wrong number of coefficients, or values that are not finite.
    pub fn from_info(model: &str, d: &[f64]) -> Result<Self, LensFault> {
        if d.iter().any(|v| !v.is_finite()) {
            return Err(LensFault::NotFinite);
        }
        let zero = d.iter().all(|v| *v == 0.0);
        match (model, d.len()) {
            ("plumb_bob" | "rational_polynomial" | "none" | "", _) if zero => Ok(Self::default()),
            ("plumb_bob", 4 | 5) => {
                let k3 = d.get(4).copied().unwrap_or(0.0);
                Ok(Self { radial: [d[0], d[1], k3], rational: [0.0; 3], tangential: [d[2], d[3]] })
            }
            // OpenCV's order is k1, k2, p1, p2, k3, k4, k5, k6.
            ("rational_polynomial", 8..=14) if d[8..].iter().all(|v| *v == 0.0) => Ok(Self {
                radial: [d[0], d[1], d[4]],
                rational: [d[5], d[6], d[7]],
                tangential: [d[2], d[3]],
            }),
            ("rational_polynomial", 9..=14) => Err(LensFault::PrismOrTilt),
            ("plumb_bob" | "rational_polynomial", n) => Err(LensFault::Count(n)),
            _ => Err(LensFault::Unknown),
        }
    }

    /// Whether the images need no resampling.
    #[must_use]
    pub fn is_pinhole(&self) -> bool {
        *self == Self::default()
    }

    /// Where the lens shows a point of the ideal image plane (z = 1).
    #[must_use]
    pub fn distorted_point(&self, x: f64, y: f64) -> (f64, f64) {
        let r2 = x * x + y * y;
        let poly = |c: &[f64; 3]| 1.0 + r2 * (c[0] + r2 * (c[1] + r2 * c[2]));
        let radial = poly(&self.radial) / poly(&self.rational);
        let [p1, p2] = self.tangential;
        (
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )
    }

    /// Whether the radial mapping decreases at this radius: further out the model is invalid, and the image
    /// would be folded over.
    fn folds_at(&self, r: f64) -> bool {
        let at = |r: f64| self.distorted_point(r, 0.0).0;
        at(r + 1e-4) <= at(r)
    }
}

/// For each pixel of the ideal image, its position in the distorted one.
#[derive(Clone, Debug)]
pub struct UndistortMap {
    width: usize,
    height: usize,
    /// Source positions in pixels; NaN outside the lens's image.
    sources: Vec<[f32; 2]>,
}

impl UndistortMap {
    /// The map of a camera; `None` for a pinhole, as its images need no resampling.
    #[must_use]
    pub fn new(camera: &Intrinsics, distortion: &Distortion) -> Option<Self> {
        if distortion.is_pinhole() {
            return None;
        }
        // Largest radius at which the model is one-to-one.
        let corner = [(0.0, 0.0), (camera.width as f64, camera.height as f64)]
            .map(|(u, v)| camera.ray_at(u, v).xy().amax())
            .iter()
            .fold(0.0, |a: f64, b| a.max(*b));
        let steps = 400;
        let limit = (0..=steps)
            .map(|i| 2.0 * corner * f64::from(i) / f64::from(steps))
            .find(|r| distortion.folds_at(*r))
            .unwrap_or(f64::INFINITY);
        let mut sources = vec![[f32::NAN; 2]; camera.width * camera.height];
        for (i, source) in sources.iter_mut().enumerate() {
            let ray = camera.ray_at((i % camera.width) as f64, (i / camera.width) as f64);
            // Beyond it, the model folds back onto pixels of other rays.
            if ray.xy().norm() >= limit {
                continue;
            }
            let (x, y) = distortion.distorted_point(ray.x, ray.y);
            *source = [(x * camera.fx + camera.cx) as f32, (y * camera.fy + camera.cy) as f32];
        }
        Some(Self { width: camera.width, height: camera.height, sources })
    }

    /// Undistorted color, bilinear; black outside the lens's image.
    #[must_use]
    pub fn undistorted_color(&self, pixels: &[[u8; 3]]) -> Vec<[u8; 3]> {
        self.sources.iter().map(|source| self.color_at(pixels, *source)).collect()
    }

    /// Color of the distorted image at a position.
    fn color_at(&self, pixels: &[[u8; 3]], [u, v]: [f32; 2]) -> [u8; 3] {
        // NaN fails every comparison, so it yields no source.
        if !(u >= 0.0 && v >= 0.0 && u <= (self.width - 1) as f32 && v <= (self.height - 1) as f32) {
            return [0; 3];
        }
        let at = |i: usize| Vector3::from(pixels[i].map(f64::from));
        bilinear(at, self.width, self.height, f64::from(u), f64::from(v))
            .map(|level| level.round() as u8)
            .into()
    }

    /// Values that must not be interpolated (depth, masks), from the nearest pixel; `outside` where there is
    /// no source.
    #[must_use]
    pub fn undistorted_nearest<T: Copy>(&self, pixels: &[T], outside: T) -> Vec<T> {
        let mut samples = vec![outside; self.sources.len()];
        for (sample, source) in samples.iter_mut().zip(&self.sources) {
            // Depth must not be averaged across the edge between two surfaces.
            let [x, y] = source.map(f32::round);
            if x >= 0.0 && y >= 0.0 && x < self.width as f32 && y < self.height as f32 {
                *sample = pixels[y as usize * self.width + x as usize];
            }
        }
        samples
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Intrinsics =
        Intrinsics { width: 160, height: 120, fx: 120.0, fy: 118.0, cx: 81.3, cy: 58.7 };

    fn models() -> [Distortion; 2] {
        [
            Distortion::from_info("plumb_bob", &[-0.25, 0.08, 0.001, -0.002, -0.01]).unwrap(),
            Distortion::from_info("rational_polynomial", &[0.4, 0.02, 0.0005, 0.001, 0.001, 0.75, 0.1, 0.01])
                .unwrap(),
        ]
    }

    /// The distorted image of a smooth scene, made by inverting the model: an independent forward model.
    fn distorted(model: &Distortion, scene: impl Fn(f64, f64) -> f64) -> Vec<f64> {
        let invert = |xd: f64, yd: f64| {
            let mut x = xd;
            let mut y = yd;
            for _ in 0..200 {
                let (a, b) = model.distorted_point(x, y);
                (x, y) = (x + 0.7 * (xd - a), y + 0.7 * (yd - b));
            }
            (x, y)
        };
        let pixel = |i: usize| {
            let ray = CAMERA.ray_at((i % CAMERA.width) as f64, (i / CAMERA.width) as f64);
            let (x, y) = invert(ray.x, ray.y);
            scene(x, y)
        };
        (0..CAMERA.width * CAMERA.height).map(pixel).collect()
    }

    #[test]
    fn undistorting_gives_the_pinhole_image_back() {
        for model in models() {
            let scene = |x: f64, y: f64| 120.0 + 60.0 * (5.0 * x).sin() + 40.0 * (4.0 * y).cos();
            let lens = distorted(&model, scene);
            let map = UndistortMap::new(&CAMERA, &model).unwrap();
            let color = map.undistorted_color(&lens.iter().map(|v| [v.round() as u8; 3]).collect::<Vec<_>>());
            let depth = map.undistorted_nearest(&lens.iter().map(|v| *v as f32).collect::<Vec<_>>(), 0.0);
            let mut seen = 0;
            let mut moved = 0.0f64;
            for i in 0..color.len() {
                let ray = CAMERA.ray_at((i % CAMERA.width) as f64, (i / CAMERA.width) as f64);
                let expected = scene(ray.x, ray.y);
                if depth[i] > 0.0 && color[i] != [0; 3] {
                    seen += 1;
                    assert!((f64::from(color[i][1]) - expected).abs() < 1.5, "{} {expected}", color[i][1]);
                    assert!((f64::from(depth[i]) - expected).abs() < 4.5);
                    moved = moved.max((lens[i] - expected).abs());
                }
            }
            assert!(seen > color.len() * 8 / 10 && moved > 10.0, "{seen} {moved}");
        }
    }

    #[test]
    fn no_distortion_passes_through() {
        for (model, d) in [("plumb_bob", vec![0.0; 5]), ("", vec![]), ("rational_polynomial", vec![0.0; 8])] {
            assert!(UndistortMap::new(&CAMERA, &Distortion::from_info(model, &d).unwrap()).is_none());
        }
    }

    #[test]
    fn other_models_are_refused() {
        assert!(Distortion::from_info("equidistant", &[0.0; 4]).is_err());
        assert!(Distortion::from_info("plumb_bob", &[0.1; 3]).is_err());
        assert!(Distortion::from_info("plumb_bob", &[0.1, f64::NAN, 0.0, 0.0]).is_err());
        assert_eq!(Distortion::from_info("rational_polynomial", &[0.1; 12]), Err(LensFault::PrismOrTilt));
    }

    #[test]
    fn a_folding_model_shows_nothing_beyond_its_fold() {
        let model = Distortion { radial: [-2.0, 0.0, 0.0], ..Distortion::default() };
        let map = UndistortMap::new(&CAMERA, &model).unwrap();
        let ones = vec![1u8; CAMERA.width * CAMERA.height];
        let seen = map.undistorted_nearest(&ones, 0);
        // r - 2 r^3 turns back at r = 1/sqrt(6).
        for (i, value) in seen.iter().enumerate() {
            let r = CAMERA.ray_at((i % CAMERA.width) as f64, (i / CAMERA.width) as f64).xy().norm();
            assert!(if r > 0.42 { *value == 0 } else { r > 0.39 || *value == 1 }, "{r}");
        }
    }
}
