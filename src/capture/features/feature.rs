//! Image features: extrema of differences of Gaussians (Lowe, IJCV 2004) with gradient descriptors.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use crate::features::{
    descriptor::{Descriptor, Gradients, descriptor_at, dominant_orientations},
    luma::luma,
    scale_space::{FloatImage, Octave, octaves_of_image},
};
use crate::frame::RgbdFrame;
use numeric::vectorized;

/// Scales of an octave. As Lowe's.
const SCALES: usize = 3;
/// Blur of the first image of an octave, pixels.
/// chosen: Lowe's value
const SIGMA_PX: f32 = 1.6;
/// Least difference of Gaussians of a feature, for gray values in `[0, 1]`.
/// chosen: a fifth of Lowe's 0.03, for the faint texture of furniture and devices
const LEAST_CONTRAST: f32 = 0.006;
/// Largest ratio of principal curvatures; a higher ratio is an edge.
/// chosen: Lowe's value
const EDGE_RATIO: f32 = 10.0;
/// Least distance of a feature from the mask's border, pixels.
const MASK_EROSION_PX: usize = 3;
/// Most features of a frame that are matched between the states.
const LIMIT: usize = 1000;

/// Settings of the feature detector.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FeatureConfig {
    /// Whether the image is doubled first, to find features down to 1 pixel of blur.
    pub upsample: bool,
    /// Most features per frame; the strongest are kept. This is not a setting.
    #[serde(skip)]
    pub limit: usize,
}

impl Default for FeatureConfig {
    fn default() -> Self {
        Self { upsample: true, limit: LIMIT }
    }
}

/// An image point with a descriptor of its surroundings.
#[derive(Clone, Debug, PartialEq)]
pub struct Feature {
    /// Sub-pixel position (u, v), pixels.
    pub pixel: [f32; 2],
    /// Blur of the scale of its extremum, pixels.
    pub scale_px: f32,
    /// Dominant gradient direction, radians from u towards v.
    pub angle_rad: f32,
    /// Difference of Gaussians at the extremum.
    pub response: f32,
    /// Descriptor of the surroundings.
    pub descriptor: Descriptor,
}

/// Margin around the object, for blurring, pixels.
const MARGIN_PX: usize = 20;

/// Features on the object in a frame, strongest first.
#[must_use]
pub fn object_features(frame: &RgbdFrame, config: &FeatureConfig) -> Vec<Feature> {
    let Some(crop) = Crop::of_object(frame) else { return Vec::new() };
    let mut found = features_of_crop(&crop, config);
    for f in &mut found {
        f.pixel = [0, 1].map(|k| f.pixel[k] + crop.corner[k] as f32);
    }
    found
}

/// Features in the whole image of a frame, strongest first; its mask is ignored.
#[must_use]
pub(super) fn image_features(frame: &RgbdFrame, config: &FeatureConfig) -> Vec<Feature> {
    let width = frame.intrinsics.width;
    let height = frame.intrinsics.height;
    let values: Vec<f32> = frame.rgb.iter().map(|rgb| luma(*rgb)).collect();
    let everywhere = vec![true; values.len()];
    features_of_crop(&Crop::whole_image(FloatImage { width, height, values }, everywhere), config)
}

/// The searched part of a frame.
struct Crop {
    /// Its brightness.
    image: FloatImage,
    /// Pixels on the object.
    object: Vec<bool>,
    /// Pixels that may be features.
    inner: Vec<bool>,
    corner: [usize; 2],
}

impl Crop {
    /// Whether one of its masks holds the pixel nearest to a point. Octave steps are powers of two, so sums
    /// are exact.
    fn mask_holds(&self, mask: &[bool], u: f32, v: f32) -> bool {
        let x = (u + 0.5) as usize;
        let y = (v + 0.5) as usize;
        x < self.image.width && y < self.image.height && mask[y * self.image.width + x]
    }

    /// The region around the object, since most frames show it in a small part; `None` without an object.
    fn of_object(frame: &RgbdFrame) -> Option<Self> {
        let w = frame.intrinsics.width;
        let h = frame.intrinsics.height;
        let object: Vec<bool> = (0..w * h).map(|i| frame.is_object(i)).collect();
        let [left, top, right, bottom] = mask_bounds(&object, w)?;
        let left = left.saturating_sub(MARGIN_PX);
        let top = top.saturating_sub(MARGIN_PX);
        let right = (right + MARGIN_PX).min(w - 1);
        let bottom = (bottom + MARGIN_PX).min(h - 1);
        let rows = (top..=bottom).map(|y| y * w + left..y * w + right + 1);
        let values = rows.clone().flat_map(|row| &frame.rgb[row]).map(|rgb| luma(*rgb)).collect();
        let object = rows.flat_map(|row| object[row].iter().copied()).collect();
        let image = FloatImage { width: right + 1 - left, height: bottom + 1 - top, values };
        Some(Self { corner: [left, top], ..Self::whole_image(image, object) })
    }

    /// The whole image.
    fn whole_image(image: FloatImage, object: Vec<bool>) -> Self {
        let inner = eroded_mask(&object, image.width, MASK_EROSION_PX);
        Self { image, object, inner, corner: [0; 2] }
    }
}

/// Bounding box of the set pixels: left, top, right, bottom.
fn mask_bounds(mask: &[bool], width: usize) -> Option<[usize; 4]> {
    mask.iter().enumerate().filter(|(_, m)| **m).map(|(i, _)| [i % width, i / width]).fold(
        None,
        |b: Option<[usize; 4]>, [x, y]| {
            let [l, t, r, bottom] = b.unwrap_or([x, y, x, y]);
            Some([l.min(x), t.min(y), r.max(x), bottom.max(y)])
        },
    )
}

/// Erosion: pixels with every pixel of their `(2 radius + 1)` square set.
fn eroded_mask(mask: &[bool], width: usize, radius: usize) -> Vec<bool> {
    // Length of the run of set pixels that ends at each pixel: along rows, then along columns over the pixels
    // with long enough runs.
    let mut out = vec![false; mask.len()];
    let mut below = vec![0usize; width];
    for (y, row) in mask.chunks_exact(width).enumerate() {
        let mut run = 0;
        for (x, set) in row.iter().enumerate() {
            run = if *set { run + 1 } else { 0 };
            // The center of a square lies `radius` before its last pixel.
            if x >= radius {
                let below = &mut below[x - radius];
                *below = if run > 2 * radius { *below + 1 } else { 0 };
                if *below > 2 * radius {
                    out[(y - radius) * width + x - radius] = true;
                }
            }
        }
    }
    out
}

/// Octave and level of an image in the scale space.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct ImageNumber {
    octave: usize,
    level: usize,
}

/// An extremum of the differences of Gaussians.
struct Extremum {
    /// The image in which it was found; it also yields the descriptor.
    found: ImageNumber,
    /// Column, pixels of the octave.
    x: f32,
    /// Row, pixels of the octave.
    y: f32,
    /// Level, interpolated.
    level: f32,
    response: f32,
}

/// Features of a crop in its pixels, strongest first.
fn features_of_crop(crop: &Crop, config: &FeatureConfig) -> Vec<Feature> {
    let octaves = octaves_of_image(&crop.image, SCALES, SIGMA_PX, config.upsample);
    let mut extrema = Vec::new();
    for (o, octave) in octaves.iter().enumerate() {
        let step = octave.step;
        for level in 1..=SCALES {
            extrema.extend(refined_extrema(octave, ImageNumber { octave: o, level }, |x, y| {
                crop.mask_holds(&crop.inner, x as f32 * step, y as f32 * step)
            }));
        }
    }
    // Strongest first, as no more than the requested number are described; the first found of equal ones.
    extrema.sort_by(|a, b| b.response.abs().total_cmp(&a.response.abs()));
    let mut gradients = BTreeMap::new();
    let mut found = Vec::new();
    for e in extrema {
        if found.len() >= config.limit {
            break;
        }
        let octave = &octaves[e.found.octave];
        let step = octave.step;
        // Gradients are cut at the mask, features at the eroded mask: the background changes with the view
        // and must not enter a descriptor.
        let gradients = gradients.entry(e.found).or_insert_with(|| {
            Gradients::of_image(&octave.gaussians[e.found.level], move |x, y| {
                crop.mask_holds(&crop.object, x as f32 * step, y as f32 * step)
            })
        });
        let scale = SIGMA_PX * 2f32.powf(e.level / SCALES as f32);
        for angle_rad in dominant_orientations(gradients, e.x, e.y, scale) {
            found.extend(descriptor_at(gradients, e.x, e.y, scale, angle_rad).map(|descriptor| Feature {
                pixel: [e.x * step, e.y * step],
                scale_px: scale * step,
                angle_rad,
                response: e.response,
                descriptor,
            }));
        }
    }
    found.truncate(config.limit);
    found
}

/// Refined extrema of one difference image of an octave.
fn refined_extrema(octave: &Octave, of: ImageNumber, inside: impl Fn(usize, usize) -> bool) -> Vec<Extremum> {
    let d = &octave.differences;
    let level = of.level;
    let w = d[level].width;
    let h = d[level].height;
    let mut found = Vec::new();
    let mut candidates = Vec::new();
    for y in 1..h - 1 {
        let rows = [y - 1, y, y + 1].map(|y| &d[level].values[y * w..(y + 1) * w]);
        candidates.clear();
        // Half, because the refined value may exceed the value at the pixel.
        stands_out(rows, 0.5 * LEAST_CONTRAST, &mut candidates);
        for &x in &candidates {
            if is_extremum(d, level, x, y, rows[1][x]) && inside(x, y) {
                found.extend(refined_extremum(d, of, [x, y]));
            }
        }
    }
    found
}

vectorized! {
    /// Appends the x of pixels in the middle one of three rows: larger than `least`, and above or below their
    /// four neighbors in these rows.
    fn stands_out(rows: [&[f32]; 3], least: f32, candidates: &mut Vec<usize>) = stand_out
}

/// Pixels compared together.
const LANES: usize = 32;

/// `count` values of a row from `first` on, padded with 0.
#[inline(always)]
fn lanes_at(row: &[f32], first: usize, count: usize) -> [f32; LANES] {
    let part = &row[first..first + count];
    <[f32; LANES]>::try_from(part).unwrap_or_else(|_| {
        // The end of a row.
        let mut lanes = [0.0; LANES];
        lanes[..count].copy_from_slice(part);
        lanes
    })
}

#[inline(always)]
fn stand_out([above, row, below]: [&[f32]; 3], least: f32, candidates: &mut Vec<usize>) {
    let n = row.len();
    for first in (1..n.saturating_sub(1)).step_by(LANES) {
        let count = LANES.min(n - 1 - first);
        let middle = lanes_at(row, first, count);
        let others = [
            lanes_at(row, first - 1, count),
            lanes_at(row, first + 1, count),
            lanes_at(above, first, count),
            lanes_at(below, first, count),
        ];
        let mut stands = [0u8; LANES];
        for k in 0..LANES {
            let value = middle[k];
            let highest = others[0][k].max(others[1][k]).max(others[2][k].max(others[3][k]));
            let lowest = others[0][k].min(others[1][k]).min(others[2][k].min(others[3][k]));
            stands[k] =
                u8::from(((value > least) & (value >= highest)) | ((-value > least) & (value <= lowest)));
        }
        if stands != [0; LANES] {
            candidates.extend((0..count).filter(|k| stands[*k] != 0).map(|k| first + k));
        }
    }
}

/// Whether a pixel is above or below all 26 neighbors in space and scale.
fn is_extremum(d: &[FloatImage], level: usize, x: usize, y: usize, value: f32) -> bool {
    let sign = value.signum();
    // Its own level first, where most pixels fail.
    [level, level - 1, level + 1].into_iter().all(|level| {
        let plane = &d[level];
        [y, y - 1, y + 1].into_iter().all(|row| {
            let i = row * plane.width + x;
            plane.values[i - 1..=i + 1].iter().all(|&n| sign * n <= sign * value)
        })
    })
}

/// Most steps from sample to sample during refinement.
const MOST_STEPS: usize = 5;
/// Largest offset from a sample, samples. Beyond one half the extremum belongs to a neighbor; the tolerance
/// keeps it from jumping between two samples forever.
/// chosen: half a sample and a tenth more
const FARTHEST: f32 = 0.6;

/// The extremum near a pixel, by a quadratic fit to the values around it; `None` if it is weak, an edge, or
/// does not converge.
fn refined_extremum(d: &[FloatImage], found: ImageNumber, [mut x, mut y]: [usize; 2]) -> Option<Extremum> {
    let mut level = found.level;
    let w = d[level].width;
    let h = d[level].height;
    for _ in 0..MOST_STEPS {
        let Quadratic { gradient, hessian, value } = Around::about_pixel(d, level, x, y).quadratic_fit();
        let offset = -hessian.lu().solve(&gradient)?;
        if offset.amax() <= FARTHEST {
            let response = value + 0.5 * gradient.dot(&offset);
            // Along an edge one principal curvature is much larger than the other, and the position is
            // uncertain.
            let xx = hessian[(0, 0)];
            let yy = hessian[(1, 1)];
            let xy = hessian[(0, 1)];
            let trace = xx + yy;
            let determinant = xx * yy - xy * xy;
            let r = EDGE_RATIO;
            let corner = determinant > 0.0 && trace * trace * r < (r + 1.0) * (r + 1.0) * determinant;
            return (response.abs() >= LEAST_CONTRAST && corner).then_some(Extremum {
                found,
                x: x as f32 + offset[0],
                y: y as f32 + offset[1],
                level: level as f32 + offset[2],
                response,
            });
        }
        // One sample at a time: the quadratic is accurate only nearby.
        x = next_sample(x, offset[0], w - 2)?;
        y = next_sample(y, offset[1], h - 2)?;
        level = next_sample(level, offset[2], SCALES)?;
    }
    None
}

/// The sample nearest to an offset, at most one away; `None` outside 1 to `last`.
fn next_sample(sample: usize, offset: f32, last: usize) -> Option<usize> {
    let next = sample as i64 + offset.round().clamp(-1.0, 1.0) as i64;
    (next >= 1 && next <= last as i64).then_some(next as usize)
}

/// Quadratic model of the values around a sample.
struct Quadratic {
    gradient: Vector3<f32>,
    hessian: Matrix3<f32>,
    value: f32,
}

/// The values around a sample of the differences, by level, row and column.
struct Around([f32; 27]);

impl Around {
    fn about_pixel(differences: &[FloatImage], level: usize, x: usize, y: usize) -> Self {
        let mut values = [0.0; 27];
        for (row, three) in values.chunks_exact_mut(3).enumerate() {
            let plane = &differences[level - 1 + row / 3];
            let first = (y - 1 + row % 3) * plane.width + x - 1;
            three.copy_from_slice(&plane.values[first..first + 3]);
        }
        Self(values)
    }

    /// The value at a step of (x, y, level) from the sample.
    fn value_at(&self, step: Vector3<i64>) -> f32 {
        self.0[(13 + step.x + 3 * step.y + 9 * step.z) as usize]
    }

    fn first_derivative(&self, a: Vector3<i64>) -> f32 {
        0.5 * (self.value_at(a) - self.value_at(-a))
    }

    fn second_derivative(&self, a: Vector3<i64>) -> f32 {
        self.value_at(a) + self.value_at(-a) - 2.0 * self.value_at(Vector3::zeros())
    }

    fn mixed_derivative(&self, a: Vector3<i64>, b: Vector3<i64>) -> f32 {
        0.25 * (self.value_at(a + b) - self.value_at(a - b) - self.value_at(b - a) + self.value_at(-a - b))
    }

    /// Gradient, Hessian and value in (x, y, level), by central differences.
    fn quadratic_fit(&self) -> Quadratic {
        let ex = Vector3::x();
        let ey = Vector3::y();
        let el = Vector3::z();
        let xy = self.mixed_derivative(ex, ey);
        let xl = self.mixed_derivative(ex, el);
        let yl = self.mixed_derivative(ey, el);
        let xx = self.second_derivative(ex);
        let yy = self.second_derivative(ey);
        let ll = self.second_derivative(el);
        let hessian = Matrix3::new(xx, xy, xl, xy, yy, yl, xl, yl, ll);
        let gradient =
            Vector3::new(self.first_derivative(ex), self.first_derivative(ey), self.first_derivative(el));
        Quadratic { gradient, hessian, value: self.value_at(Vector3::zeros()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gaussian blobs at sub-pixel positions.
    fn blobs(width: usize, height: usize, centers: &[([f32; 2], f32)]) -> FloatImage {
        let mut p = FloatImage::zeros(width, height);
        for i in 0..width * height {
            let x = (i % width) as f32;
            let y = (i / width) as f32;
            p.values[i] = 0.2
                + centers
                    .iter()
                    .map(|(c, s)| {
                        let dx = x - c[0];
                        let dy = y - c[1];
                        0.5 * (-(dx * dx + 0.8 * dy * dy + 0.3 * dx * dy) / (2.0 * s * s)).exp()
                    })
                    .sum::<f32>();
        }
        p
    }

    #[test]
    fn blobs_are_found_where_they_are_to_a_tenth_of_a_pixel() {
        let centers = [([30.3, 40.7], 3.0), ([80.6, 25.2], 4.5), ([90.45, 70.9], 2.5)];
        let image = blobs(128, 100, &centers);
        for upsample in [false, true] {
            let config = FeatureConfig { upsample, ..FeatureConfig::default() };
            let crop = Crop::whole_image(image.clone(), vec![true; 128 * 100]);
            let found = features_of_crop(&crop, &config);
            for (c, s) in centers {
                let near = found.iter().find(|f| (f.pixel[0] - c[0]).hypot(f.pixel[1] - c[1]) < 0.1);
                let f = near.unwrap_or_else(|| panic!("no feature at {c:?}"));
                assert!((f.scale_px / s - 1.0).abs() < 0.25, "{} for {s}", f.scale_px);
            }
        }
    }

    #[test]
    fn an_edge_and_the_outside_of_the_mask_have_no_features() {
        let mut edge = FloatImage::zeros(96, 96);
        (0..96 * 96).for_each(|i| edge.values[i] = if i % 96 > 47 { 0.9 } else { 0.1 });
        let config = FeatureConfig::default();
        let found = features_of_crop(&Crop::whole_image(edge, vec![true; 96 * 96]), &config);
        assert!(found.iter().all(|f| f.pixel[1] < 16.0 || f.pixel[1] > 80.0));
        let image = blobs(96, 96, &[([30.0, 30.0], 3.0), ([70.0, 70.0], 3.0)]);
        let mask: Vec<bool> = (0..96 * 96).map(|i| i % 96 < 50).collect();
        let found = features_of_crop(&Crop::whole_image(image, mask), &config);
        assert!(!found.is_empty() && found.iter().all(|f| f.pixel[0] < 46.5));
    }

    #[test]
    fn erosion_keeps_what_is_far_from_the_border() {
        let mask: Vec<bool> =
            (0..400).map(|i| (3..15).contains(&(i % 20)) && (5..18).contains(&(i / 20))).collect();
        let small = eroded_mask(&mask, 20, 2);
        for (i, &kept) in small.iter().enumerate() {
            assert_eq!(kept, (5..13).contains(&(i % 20)) && (7..16).contains(&(i / 20)), "{i}");
        }
    }
}
