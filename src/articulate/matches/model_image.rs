//! Images as a matching model takes them, and pixels back to the frame.

use capture::{RgbdFrame, luma};

/// Sides of an image are multiples of this where the model leaves its size open, pixels.
pub const SIDE_MULTIPLE: usize = 32;

/// Layout of a model's input image, `[1, channels, height, width]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageFormat {
    /// 1: luma, 3: red, green, blue.
    pub channels: usize,
    /// Pixels, where the model fixes them.
    pub height: Option<usize>,
    /// Pixels, where the model fixes them.
    pub width: Option<usize>,
}

/// Values in `[0, 1]`, one plane a channel, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `channels * height * width` values.
    pub values: Vec<f32>,
    /// Frame pixels per model pixel along u and v.
    frame_per_model: [f32; 2],
    frame_size: [usize; 2],
}

impl ModelImage {
    /// The frame in the model's format: scaled with its aspect kept to fit, by averages where it shrinks, at
    /// the upper left, its border repeated to the right and below. Where the model leaves the size open the
    /// longer side is `max_side_px` at most.
    pub fn from_frame(frame: &RgbdFrame, format: ImageFormat, max_side_px: usize) -> Self {
        let size = [frame.intrinsics.width, frame.intrinsics.height];
        let fixed = [format.width, format.height];
        let room = [0, 1].map(|k| fixed[k].unwrap_or(max_side_px));
        let scale = [0, 1].map(|k| room[k] as f64 / size[k] as f64).into_iter().fold(f64::INFINITY, f64::min);
        // An image is only made larger where the model wants both sides so.
        let scale = if fixed.iter().all(Option::is_some) { scale } else { scale.min(1.0) };
        let inner = [0, 1].map(|k| ((size[k] as f64 * scale).round() as usize).clamp(1, room[k]));
        let outer = [0, 1].map(|k| fixed[k].unwrap_or(inner[k].next_multiple_of(SIDE_MULTIPLE)));
        let taps = [0, 1].map(|k| taps_of_targets(size[k], inner[k]));
        let planes: Vec<Vec<f32>> = if format.channels == 1 {
            vec![frame.rgb.iter().map(|c| luma(*c)).collect()]
        } else {
            (0..3).map(|k| frame.rgb.iter().map(|c| f32::from(c[k]) / 255.0).collect()).collect()
        };
        let values =
            planes.iter().flat_map(|plane| padded(&resampled(plane, size[0], &taps), inner, outer)).collect();
        let frame_per_model = [0, 1].map(|k| size[k] as f32 / inner[k] as f32);
        Self { width: outer[0], height: outer[1], values, frame_per_model, frame_size: size }
    }

    /// The frame's pixel at a model pixel (u, v), both with integers at pixel centers; `None` outside the
    /// frame.
    pub fn frame_pixel(&self, model_pixel: [f32; 2]) -> Option<[f32; 2]> {
        // Scaling keeps the corner of the first pixel, half a pixel from its center.
        let pixel = [0, 1].map(|k| (model_pixel[k] + 0.5) * self.frame_per_model[k] - 0.5);
        let is_inside = (0..2).all(|k| pixel[k] >= 0.0 && pixel[k] <= (self.frame_size[k] - 1) as f32);
        is_inside.then_some(pixel)
    }
}

/// Weights of the source samples from `first` on for one target sample.
struct Tap {
    first: usize,
    weights: Vec<f32>,
}

impl Tap {
    /// The weighted sum of the source samples, by their index.
    fn sum(&self, value: impl Fn(usize) -> f32) -> f32 {
        self.weights.iter().enumerate().map(|(k, w)| w * value(self.first + k)).sum()
    }
}

/// The tap of every target sample: a triangle as wide as two source samples, or two target samples where the
/// image shrinks.
fn taps_of_targets(source: usize, target: usize) -> Vec<Tap> {
    let ratio = source as f64 / target as f64;
    let reach = ratio.max(1.0);
    let mut taps = Vec::with_capacity(target);
    for i in 0..target {
        let center = (i as f64 + 0.5) * ratio - 0.5;
        let first = (center - reach).ceil().max(0.0) as usize;
        let last = ((center + reach).floor() as usize).min(source - 1);
        let weights: Vec<f64> =
            (first..=last).map(|s| (1.0 - (s as f64 - center).abs() / reach).max(0.0)).collect();
        let sum: f64 = weights.iter().sum();
        taps.push(Tap { first, weights: weights.into_iter().map(|w| (w / sum) as f32).collect() });
    }
    taps
}

/// A plane of width `width` resampled along rows, then along columns.
fn resampled(source: &[f32], width: usize, taps: &[Vec<Tap>; 2]) -> Vec<f32> {
    let rows = source.chunks_exact(width);
    let narrow: Vec<f32> = rows.flat_map(|row| taps[0].iter().map(move |t| t.sum(|u| row[u]))).collect();
    let across = taps[0].len();
    taps[1]
        .iter()
        .flat_map(|t| (0..across).map(|u| t.sum(|v| narrow[v * across + u])).collect::<Vec<_>>())
        .collect()
}

/// The last column and row repeated up to `outer`.
fn padded(values: &[f32], inner: [usize; 2], outer: [usize; 2]) -> Vec<f32> {
    let at = |u: usize, v: usize| values[v.min(inner[1] - 1) * inner[0] + u.min(inner[0] - 1)];
    (0..outer[1]).flat_map(|v| (0..outer[0]).map(move |u| at(u, v))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{Intrinsics, Pose};

    const OPEN: ImageFormat = ImageFormat { channels: 1, height: None, width: None };

    /// Red rises along u, green along v.
    fn ramp(width: usize, height: usize) -> RgbdFrame {
        RgbdFrame {
            id: "0_0000".to_owned(),
            stamp_nanos: 0,
            intrinsics: Intrinsics { width, height, fx: 50.0, fy: 50.0, cx: 0.0, cy: 0.0 },
            world_from_camera: Pose::identity(),
            rgb: (0..width * height).map(|i| [(i % width) as u8, (i / width) as u8, 0]).collect(),
            depth_m: vec![1.0; width * height],
            mask: None,
            readings: Vec::new(),
        }
    }

    #[test]
    fn a_frame_that_fits_keeps_its_pixels_and_is_filled_up() {
        let image = ModelImage::from_frame(&ramp(40, 30), OPEN, 640);
        assert_eq!((image.width, image.height, image.values.len()), (64, 32, 64 * 32));
        let luma = |u: f32, v: f32| (0.299 * u + 0.587 * v) / 255.0;
        for (u, v, expected) in [
            (0, 0, luma(0.0, 0.0)),
            (39, 29, luma(39.0, 29.0)),
            (63, 31, luma(39.0, 29.0)),
            (50, 3, luma(39.0, 3.0)),
        ] {
            assert!((image.values[v * 64 + u] - expected).abs() < 1e-6, "{u} {v}");
        }
        assert_eq!(image.frame_pixel([12.25, 7.0]), Some([12.25, 7.0]));
        for outside in [[40.0, 3.0], [3.0, 29.5], [-0.1, 3.0], [f32::NAN, 3.0]] {
            assert_eq!(image.frame_pixel(outside), None);
        }
    }

    #[test]
    fn scaled_images_show_the_pixel_that_is_given_back() {
        let width = 200;
        let height = 120;
        let fixed = |width, height| ImageFormat { channels: 3, width: Some(width), height: Some(height) };
        for (format, max_side_px, inner) in [
            (ImageFormat { channels: 3, ..OPEN }, 100, [100, 60]),
            (fixed(64, 64), 1000, [64, 38]),
            (fixed(400, 300), 100, [400, 240]),
            (ImageFormat { height: None, ..fixed(50, 0) }, 1000, [50, 30]),
        ] {
            let image = ModelImage::from_frame(&ramp(width, height), format, max_side_px);
            assert_eq!(image.values.len(), 3 * image.width * image.height);
            let plane = image.width * image.height;
            for (u, v) in [(inner[0] / 3, inner[1] / 2), (inner[0] / 2, inner[1] / 5)] {
                let Some(pixel) = image.frame_pixel([u as f32, v as f32]) else { panic!("{u} {v}") };
                let at = v * image.width + u;
                let shown = [image.values[at] * 255.0, image.values[plane + at] * 255.0];
                assert!(
                    (shown[0] - pixel[0]).abs() < 0.06 && (shown[1] - pixel[1]).abs() < 0.06,
                    "{format:?}: {shown:?} {pixel:?}"
                );
                assert_eq!(image.values[2 * plane + at], 0.0);
            }
            assert_eq!(image.frame_pixel([inner[0] as f32 + 1.0, 0.0]), None);
        }
    }
}
