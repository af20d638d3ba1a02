//! Gaussian scale space of a grayscale image (Lowe, "Distinctive image features from scale-invariant
//! keypoints", IJCV 2004, section 3): octaves of equally spaced blurs and their differences.

use numeric::vectorized;

/// A grayscale image, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct FloatImage {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// `width * height` values.
    pub values: Vec<f32>,
}

impl FloatImage {
    /// An image of zeros.
    pub fn zeros(width: usize, height: usize) -> Self {
        Self { width, height, values: vec![0.0; width * height] }
    }

    /// Value at a pixel inside the image.
    #[cfg(test)]
    pub fn value_at(&self, x: usize, y: usize) -> f32 {
        self.values[y * self.width + x]
    }

    /// Doubles the image by linear interpolation; pixel `(x, y)` becomes pixel `(2 x, 2 y)`, so that
    /// coordinates halve exactly.
    pub fn doubled(&self) -> Self {
        let w = self.width;
        let h = self.height;
        let mut out = Self::zeros(2 * w, 2 * h);
        let row = |y: usize| &self.values[y * w..(y + 1) * w];
        for (y, out) in out.values.chunks_exact_mut(2 * w).enumerate() {
            let above = row(y / 2);
            let below = row(y.div_ceil(2).min(h - 1));
            for (x, pair) in out.chunks_exact_mut(2).enumerate() {
                for (out, right) in pair.iter_mut().zip([x, (x + 1).min(w - 1)]) {
                    *out = 0.25 * (above[x] + above[right] + below[x] + below[right]);
                }
            }
        }
        out
    }

    /// Every second pixel of every second row.
    pub fn halved(&self) -> Self {
        let w = self.width / 2;
        let h = self.height / 2;
        let mut out = Self::zeros(w, h);
        for (y, out) in out.values.chunks_exact_mut(w).enumerate() {
            let row = &self.values[2 * y * self.width..];
            out.iter_mut().zip(row.iter().step_by(2)).for_each(|(out, value)| *out = *value);
        }
        out
    }

    /// Convolution with a Gaussian of the given standard deviation in pixels, truncated at 4 standard
    /// deviations; the border pixel is repeated outside.
    pub fn blurred(&self, sigma_px: f32) -> Self {
        let mut rows = Self::zeros(self.width, self.height);
        let mut out = Self::zeros(self.width, self.height);
        blur(self, &half_kernel(sigma_px), &mut rows, &mut out);
        out
    }

    /// Pixel-wise difference `self - other` of images of the same size.
    pub fn difference_from(&self, other: &Self) -> Self {
        let values = self.values.iter().zip(&other.values).map(|(a, b)| a - b).collect();
        Self { width: self.width, height: self.height, values }
    }
}

vectorized! {
    /// Convolves an image along rows, then along columns.
    fn blur(image: &FloatImage, kernel: &[f32], rows: &mut FloatImage, out: &mut FloatImage) = convolve
}

#[inline(always)]
fn convolve(image: &FloatImage, kernel: &[f32], rows: &mut FloatImage, out: &mut FloatImage) {
    let r = kernel.len() - 1;
    let w = image.width;
    let h = image.height;
    let mut padded = vec![0.0; w + 2 * r];
    for y in 0..h {
        let row = &image.values[y * w..(y + 1) * w];
        padded[..r].fill(row[0]);
        padded[r..r + w].copy_from_slice(row);
        padded[r + w..].fill(row[w - 1]);
        let out = &mut rows.values[y * w..(y + 1) * w];
        for (o, &c) in out.iter_mut().zip(&padded[r..r + w]) {
            *o = kernel[0] * c;
        }
        for (j, &k) in kernel.iter().enumerate().skip(1) {
            add_scaled_pair(out, &padded[r - j..r - j + w], &padded[r + j..r + j + w], k);
        }
    }
    for y in 0..h {
        let target = &mut out.values[y * w..(y + 1) * w];
        for (o, &c) in target.iter_mut().zip(&rows.values[y * w..(y + 1) * w]) {
            *o = kernel[0] * c;
        }
        for (j, &k) in kernel.iter().enumerate().skip(1) {
            let above = y.saturating_sub(j);
            let below = (y + j).min(h - 1);
            add_scaled_pair(
                target,
                &rows.values[above * w..(above + 1) * w],
                &rows.values[below * w..(below + 1) * w],
                k,
            );
        }
    }
}

/// `out += factor * (a + b)`.
#[inline(always)]
fn add_scaled_pair(out: &mut [f32], a: &[f32], b: &[f32], factor: f32) {
    for ((o, &p), &q) in out.iter_mut().zip(a).zip(b) {
        *o += factor * (p + q);
    }
}

/// Center and right half of a normalized Gaussian kernel.
fn half_kernel(sigma_px: f32) -> Vec<f32> {
    let radius = (4.0 * sigma_px).ceil().max(1.0) as usize;
    let mut half: Vec<f32> = (0..=radius).map(|i| (-0.5 * (i as f32 / sigma_px).powi(2)).exp()).collect();
    let sum = half[0] + 2.0 * half[1..].iter().sum::<f32>();
    half.iter_mut().for_each(|k| *k /= sum);
    half
}

/// One octave: `scales + 3` Gaussian images and the `scales + 2` differences of neighbors.
pub struct Octave {
    /// Gaussian images; image `i` has blur `sigma * 2^(i / scales)` in pixels of this octave.
    pub gaussians: Vec<FloatImage>,
    /// `differences[i] = gaussians[i + 1] - gaussians[i]`.
    pub differences: Vec<FloatImage>,
    /// Pixels of the input image per pixel of this octave.
    pub step: f32,
}

/// Smallest side of an octave, pixels.
const SMALLEST: usize = 12;
/// Assumed blur of a camera image, pixels. derived: the least without aliasing (Lowe 2004, section 3.3)
const CAMERA_BLUR_PX: f32 = 0.5;

/// All octaves of an image, finest first; `upsample` doubles the image first.
pub fn octaves_of_image(image: &FloatImage, scales: usize, sigma_px: f32, upsample: bool) -> Vec<Octave> {
    let mut step = if upsample { 0.5 } else { 1.0 };
    let start = if upsample { image.doubled() } else { image.clone() };
    let blur = CAMERA_BLUR_PX / step;
    // The camera has blurred the image already; variances add.
    let mut base = start.blurred((sigma_px * sigma_px - blur * blur).max(0.01).sqrt());
    let ratio = 2f32.powf(1.0 / scales as f32);
    let mut all = Vec::new();
    while base.width.min(base.height) >= SMALLEST {
        let mut gaussians = vec![base];
        for i in 1..scales + 3 {
            let before = sigma_px * ratio.powi(i as i32 - 1);
            let added = before * (ratio * ratio - 1.0).sqrt();
            gaussians.push(gaussians[i - 1].blurred(added));
        }
        let differences = gaussians.windows(2).map(|g| g[1].difference_from(&g[0])).collect();
        // This image has twice the blur of the first; halved, it has the same blur in pixels.
        base = gaussians[scales].halved();
        all.push(Octave { gaussians, differences, step });
        step *= 2.0;
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blurring_keeps_the_sum_and_adds_the_variance() {
        let mut p = FloatImage::zeros(61, 61);
        p.values[30 * 61 + 30] = 1.0;
        let b = p.blurred(1.5).blurred(2.0);
        let sum: f32 = b.values.iter().sum();
        assert!((sum - 1.0).abs() < 1e-4);
        let variance: f32 = (0..61 * 61).map(|i| b.values[i] * ((i % 61) as f32 - 30.0).powi(2)).sum();
        assert!((variance - (1.5f32.powi(2) + 4.0)).abs() < 0.02, "{variance}");
    }

    #[test]
    fn a_ramp_survives_doubling_blurring_and_halving_away_from_the_border() {
        let mut p = FloatImage::zeros(40, 32);
        (0..40 * 32).for_each(|i| p.values[i] = (i % 40) as f32 * 0.01 + (i / 40) as f32 * 0.02);
        let d = p.doubled();
        assert!((d.value_at(21, 10) - (0.105 + 0.1)).abs() < 1e-6);
        let b = d.blurred(1.2);
        assert!((b.value_at(40, 30) - (0.2 + 0.3)).abs() < 1e-5);
        assert_eq!(d.halved(), p);
    }
}
