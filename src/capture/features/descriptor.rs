//! Orientation and description of image features: gradient histograms (Lowe, IJCV 2004, sections 5 and 6)
//! compared by the Hellinger kernel (Arandjelovic and Zisserman, "Three things everyone should know...", CVPR
//! 2012).

use std::{
    f32::consts::{FRAC_PI_2, PI, SQRT_2, TAU},
    ops::Range,
};

use crate::features::scale_space::FloatImage;
use numeric::vectorized;

/// Numbers in a descriptor: 4 x 4 cells of 8 gradient directions.
pub const DESCRIPTOR_LENGTH: usize = 128;
/// Norm of every descriptor. derived: its square is 2^24, so that single floats hold inner products exactly.
pub const DESCRIPTOR_NORM: f32 = 4096.0;

/// A unit vector scaled by [`DESCRIPTOR_NORM`] and rounded.
pub type Descriptor = [i16; DESCRIPTOR_LENGTH];

/// Bins of the orientation histogram.
const ORIENTATIONS: usize = 36;
/// Cells along one side of the descriptor.
const CELLS: usize = 4;
/// Cells along one side of the descriptor, with one border cell on either side.
const SIDE: usize = CELLS + 2;
/// Gradient directions per cell.
const DIRECTIONS: usize = 8;

/// Gradient magnitude and direction of pixels (radians in `[0, 2 pi)`, counter-clockwise with y down). Only
/// requested stretches of rows are computed, as most pixels lie near no feature.
pub struct Gradients<'a, K> {
    image: &'a FloatImage,
    keep: K,
    magnitudes: Vec<f32>,
    directions: Vec<f32>,
    /// By row, the columns computed so far.
    known: Vec<Range<usize>>,
}

/// Pixels processed together.
const LANES: usize = 16;

/// A stretch of a row relative to a point: its y offset and, per lane, Gaussian-weighted magnitude, x offset
/// and direction; lanes past its end have magnitude 0.
struct Stretch {
    below: f32,
    weights: [f32; LANES],
    right: [f32; LANES],
    directions: [f32; LANES],
}

impl<'a, K: Fn(usize, usize) -> bool> Gradients<'a, K> {
    /// Gradients by central differences; border pixels, and those rejected by `keep`, have magnitude 0.
    pub fn of_image(image: &'a FloatImage, keep: K) -> Self {
        let pixels = image.width * image.height;
        // Zeroed memory costs nothing where it is never read.
        let magnitudes = vec![0.0; pixels];
        let directions = vec![0.0; pixels];
        Self { image, keep, magnitudes, directions, known: vec![0..0; image.height] }
    }

    /// Computes the gradients of a stretch of a row, unless known.
    fn look_at(&mut self, y: usize, columns: Range<usize>) {
        let Range { start, end } = self.known[y].clone();
        if start < end && start <= columns.start && columns.end <= end {
            return;
        }
        let FloatImage { width, height, .. } = *self.image;
        let all = if start < end { start.min(columns.start)..end.max(columns.end) } else { columns };
        self.known[y] = all.clone();
        let inner = all.start.max(1)..all.end.min(width - 1);
        if y == 0 || y + 1 >= height || inner.is_empty() {
            return;
        }
        let row = |y: usize| &self.image.values[y * width..(y + 1) * width];
        let at = y * width + inner.start..y * width + inner.end;
        let magnitudes = &mut self.magnitudes[at.clone()];
        let directions = &mut self.directions[at];
        let [before, behind] = [inner.start - 1..inner.end - 1, inner.start + 1..inner.end + 1];
        polar(
            [&row(y)[before], &row(y)[behind]],
            [&row(y - 1)[inner.clone()], &row(y + 1)[inner.clone()]],
            [magnitudes, directions],
        );
        for x in inner.filter(|x| !(self.keep)(*x, y)) {
            self.magnitudes[y * width + x] = 0.0;
        }
    }

    /// Visits the pixels near a point by stretches of rows: `columns` gives the x offsets of a row from its y
    /// offset, and `sigma` is the standard deviation of the Gaussian around the point.
    fn visit_around(
        &mut self,
        [x, y]: [f32; 2],
        radius: f32,
        sigma: f32,
        columns: impl Fn(f32) -> [f32; 2],
        mut visit: impl FnMut(&Stretch),
    ) {
        // The Gaussian is a product of a row factor and a column factor, which saves exponentials.
        let share = |offset: f32| (-offset * offset / (2.0 * sigma * sigma)).exp();
        let whole = pixels_between(x - radius, x + radius, self.image.width);
        let of_columns: Vec<f32> = whole.clone().map(|px| share(px as f32 - x)).collect();
        for py in pixels_between(y - radius, y + radius, self.image.height) {
            let below = py as f32 - y;
            let [first, last] = columns(below);
            let row = pixels_between(x + first, x + last, self.image.width);
            let row = row.start.max(whole.start)..row.end.min(whole.end);
            if row.is_empty() {
                continue;
            }
            self.look_at(py, row.clone());
            let of_row = share(below);
            for start in row.clone().step_by(LANES) {
                let count = LANES.min(row.end - start);
                let at = py * self.image.width + start;
                let of_columns = &of_columns[start - whole.start..];
                let mut stretch =
                    Stretch { below, weights: [0.0; LANES], right: [0.0; LANES], directions: [0.0; LANES] };
                for k in 0..count {
                    stretch.weights[k] = self.magnitudes[at + k] * of_row * of_columns[k];
                    stretch.right[k] = (start + k) as f32 - x;
                    stretch.directions[k] = self.directions[at + k];
                }
                visit(&stretch);
            }
        }
    }
}

vectorized! {
    /// Magnitude and direction of gradients from the values [left, right] and [above, below] of each pixel.
    fn polar(beside: [&[f32]; 2], about: [&[f32]; 2], out: [&mut [f32]; 2]) = polar_kernel
}

#[inline(always)]
fn polar_kernel(
    [left, right]: [&[f32]; 2],
    [above, below]: [&[f32]; 2],
    [magnitudes, directions]: [&mut [f32]; 2],
) {
    let n = magnitudes.len();
    let left = &left[..n];
    let right = &right[..n];
    let above = &above[..n];
    let below = &below[..n];
    let directions = &mut directions[..n];
    for i in 0..n {
        let dx = right[i] - left[i];
        let dy = below[i] - above[i];
        magnitudes[i] = (dx * dx + dy * dy).sqrt();
        directions[i] = direction_rad(dx, dy);
    }
}

/// Angle of a vector in `[0, 2 pi)`, radians; 0 for the zero vector.
///
/// The polynomial of the arctangent is 4.4.49 of Abramowitz and Stegun, accurate to 2e-8.
#[inline(always)]
fn direction_rad(dx: f32, dy: f32) -> f32 {
    let x = dx.abs();
    let y = dy.abs();
    let t = x.min(y) / x.max(y).max(f32::MIN_POSITIVE);
    let s = t * t;
    let p = 0.002_866_225_7 * s - 0.016_165_737;
    let p = (p * s + 0.042_909_614) * s - 0.075_289_64;
    let p = (p * s + 0.106_562_64) * s - 0.142_089;
    let p = (p * s + 0.199_935_51) * s - 0.333_331_45;
    let first = t + t * s * p;
    let first = if y > x { FRAC_PI_2 - first } else { first };
    let upper = if dx < 0.0 { PI - first } else { first };
    in_circle(if dy < 0.0 { -upper } else { upper })
}

/// Wraps an angle in `(-2 pi, 4 pi)` to `[0, 2 pi)` without a division.
#[inline(always)]
fn in_circle(angle_rad: f32) -> f32 {
    let angle_rad = if angle_rad < 0.0 { angle_rad + TAU } else { angle_rad };
    if angle_rad >= TAU { angle_rad - TAU } else { angle_rad }
}

/// Dominant gradient directions around a point, radians, strongest first; at most three.
pub fn dominant_orientations(
    gradients: &mut Gradients<'_, impl Fn(usize, usize) -> bool>,
    x: f32,
    y: f32,
    scale_px: f32,
) -> Vec<f32> {
    // Lowe's section 5: a window of 1.5 scales, peaks from 80 % of the highest.
    let sigma = 1.5 * scale_px;
    let radius = 4.5 * scale_px;
    // The histogram is circular: the last bin is next to the first.
    let mut turns = [0.0f32; ORIENTATIONS + 2];
    gradients.visit_around(
        [x, y],
        radius,
        sigma,
        |_| [-radius, radius],
        |stretch| {
            for (direction, weight) in stretch.directions.iter().zip(&stretch.weights) {
                let bin = direction * (ORIENTATIONS as f32 / TAU);
                let low = bin as usize;
                let fraction = bin - low as f32;
                turns[low] += weight * (1.0 - fraction);
                turns[low + 1] += weight * fraction;
            }
        },
    );
    turns[0] += turns[ORIENTATIONS];
    turns[1] += turns[ORIENTATIONS + 1];
    let mut histogram: [f32; ORIENTATIONS] = std::array::from_fn(|i| turns[i]);
    // Smoothed, so that noise makes no second peak next to the first.
    for _ in 0..2 {
        let h = histogram;
        for i in 0..ORIENTATIONS {
            histogram[i] = 0.25 * h[(i + ORIENTATIONS - 1) % ORIENTATIONS]
                + 0.5 * h[i]
                + 0.25 * h[(i + 1) % ORIENTATIONS];
        }
    }
    let highest = histogram.iter().copied().fold(0.0, f32::max);
    let mut peaks = Vec::new();
    for i in 0..ORIENTATIONS {
        let l = histogram[(i + ORIENTATIONS - 1) % ORIENTATIONS];
        let c = histogram[i];
        let r = histogram[(i + 1) % ORIENTATIONS];
        if c > 0.0 && c >= 0.8 * highest && c > l && c >= r {
            // The maximum of the parabola through three bins.
            let shift = 0.5 * (l - r) / (l - 2.0 * c + r).min(-1e-12);
            peaks.push((c, ((i as f32 + shift) / ORIENTATIONS as f32 * TAU).rem_euclid(TAU)));
        }
    }
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
    peaks.into_iter().take(3).map(|p| p.1).collect()
}

/// Range of pixels, within `n`, between two coordinates.
#[inline(always)]
fn pixels_between(first: f32, last: f32, n: usize) -> Range<usize> {
    (first.ceil().max(0.0) as usize)..(last.floor().max(-1.0) + 1.0).min(n as f32) as usize
}

/// Range of x offsets `dx` in the row `dy` of the rotated square, where `|cos dx + sin dy|` and `|-sin dx +
/// cos dy|` are below its reach.
fn columns_of_square([sin, cos]: [f32; 2], reach: f32, dy: f32) -> [f32; 2] {
    let a = offsets_within(reach, cos, sin * dy);
    let b = offsets_within(reach, -sin, cos * dy);
    [a[0].max(b[0]), a[1].min(b[1])]
}

/// Bounds of `x` with `|slope x + middle|` below a reach.
fn offsets_within(reach: f32, slope: f32, middle: f32) -> [f32; 2] {
    let slope = if slope.abs() < 1e-6 { 1e-6 } else { slope };
    let a = (-reach - middle) / slope;
    let b = (reach - middle) / slope;
    [a.min(b), a.max(b)]
}

/// The descriptor of a square with side 12 `scale_px` around a point, rotated by `angle_rad`; `None` without
/// gradients.
pub fn descriptor_at(
    gradients: &mut Gradients<'_, impl Fn(usize, usize) -> bool>,
    x: f32,
    y: f32,
    scale_px: f32,
    angle_rad: f32,
) -> Option<Descriptor> {
    let cell_px = 3.0 * scale_px;
    let (sin, cos) = angle_rad.sin_cos();
    let half = 0.5 * CELLS as f32;
    let reach = cell_px * (half + 0.5);
    let mut cells: Cells = [[[0.0; DIRECTIONS + 2]; SIDE * SIDE]; 2];
    gradients.visit_around(
        [x, y],
        SQRT_2 * reach,
        half * cell_px,
        |dy| columns_of_square([sin, cos], reach, dy),
        |stretch| add(&mut cells, stretch, [sin, cos], [cell_px, angle_rad]),
    );
    let mut values = [0.0f32; DESCRIPTOR_LENGTH];
    for j in 0..CELLS {
        for i in 0..CELLS {
            let at = (j * CELLS + i) * DIRECTIONS;
            let [even, odd] = [0, 1].map(|k| &cells[k][(j + 1) * SIDE + i + 1]);
            let cell: [f32; DIRECTIONS + 2] = std::array::from_fn(|d| even[d] + odd[d]);
            values[at..at + DIRECTIONS].copy_from_slice(&cell[..DIRECTIONS]);
            // The directions are circular: those past the last are the first.
            values[at] += cell[DIRECTIONS];
            values[at + 1] += cell[DIRECTIONS + 1];
        }
    }
    hellinger_normalized(&mut values)
}

/// Histograms of the cells, row by row, with an unused border. There are two copies, so that sums of
/// neighboring pixels need not wait for each other.
type Cells = [[[f32; DIRECTIONS + 2]; SIDE * SIDE]; 2];

vectorized! {
    /// Adds a stretch of pixels. `turn` holds the sine and cosine of the angle of direction 0, `cell` the
    /// side of a cell in pixels, and that angle.
    fn add(cells: &mut Cells, stretch: &Stretch, turn: [f32; 2], cell: [f32; 2]) = add_stretch
}

#[inline(always)]
fn add_stretch(cells: &mut Cells, stretch: &Stretch, [sin, cos]: [f32; 2], [cell_px, angle_rad]: [f32; 2]) {
    /// derived: the last sample of a side
    const TOP: f32 = (SIDE - 1) as f32;
    // Cell coordinates include the border: inner cell 0 is centered at 1.
    let middle = 0.5 * TOP;
    let mut at = [0i32; LANES];
    let mut bins = [0i32; LANES];
    let mut fractions = [[0.0f32; LANES]; 3];
    for k in 0..LANES {
        let dx = stretch.right[k];
        let dy = stretch.below;
        let u = (cos * dx + sin * dy) / cell_px + middle;
        let v = (cos * dy - sin * dx) / cell_px + middle;
        let bin = in_circle(stretch.directions[k] - angle_rad) * (DIRECTIONS as f32 / TAU);
        let inside = (stretch.weights[k] > 0.0) & (u > 0.0) & (u < TOP) & (v > 0.0) & (v < TOP);
        let iu = u as i32;
        let iv = v as i32;
        let ib = bin as i32;
        (at[k], bins[k]) = (if inside { iv * SIDE as i32 + iu } else { -1 }, ib);
        fractions[0][k] = u - iu as f32;
        fractions[1][k] = v - iv as f32;
        fractions[2][k] = bin - ib as f32;
    }
    let [right, below, turned] = fractions;
    for k in 0..LANES {
        let Ok(at) = usize::try_from(at[k]) else { continue };
        let weight = stretch.weights[k];
        let bin = bins[k] as usize;
        let cells = &mut cells[k % 2];
        // Spread over the eight nearest bins, so that small shifts change the descriptor little.
        let [above, below] = [weight * (1.0 - below[k]), weight * below[k]];
        let left = 1.0 - right[k];
        let right = right[k];
        let shares = [above * left, above * right, below * left, below * right];
        for (cell, share) in [at, at + 1, at + SIDE, at + SIDE + 1].into_iter().zip(shares) {
            let pair = &mut cells[cell][bin..bin + 2];
            pair[0] += share * (1.0 - turned[k]);
            pair[1] += share * turned[k];
        }
    }
}

/// Clips components at 0.2 of the norm, divides by the sum and takes square roots.
fn hellinger_normalized(values: &mut [f32; DESCRIPTOR_LENGTH]) -> Option<Descriptor> {
    let norm = values.iter().map(|v| v * v).sum::<f32>().sqrt();
    if norm < 1e-6 {
        return None;
    }
    // Light changes strong edges most; none should dominate the descriptor (Lowe's section 6.1).
    values.iter_mut().for_each(|v| *v = (*v / norm).min(0.2));
    let sum = values.iter().sum::<f32>();
    // Square roots of values with sum 1 have norm 1: docs/method.md (4.1).
    Some(values.map(|v| ((v / sum).sqrt() * DESCRIPTOR_NORM).round() as i16))
}

/// Inner product; it fits, as it is at most `DESCRIPTOR_NORM^2` up to rounding.
#[inline(always)]
pub fn descriptor_product(a: &Descriptor, b: &Descriptor) -> i32 {
    a.iter().zip(b).map(|(&p, &q)| i32::from(p) * i32::from(q)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cosine between two descriptors, in `[0, 1]`.
    fn similarity(a: &Descriptor, b: &Descriptor) -> f32 {
        descriptor_product(a, b) as f32 / (DESCRIPTOR_NORM * DESCRIPTOR_NORM)
    }

    /// A smooth pattern sampled about a center, turned by `angle` and scaled.
    fn pattern(angle: f32, scale: f32) -> FloatImage {
        let w = 121;
        let h = 121;
        let mut p = FloatImage::zeros(w, h);
        for y in 0..h {
            for x in 0..w {
                let dx = (x as f32 - 60.0) / scale;
                let dy = (y as f32 - 60.0) / scale;
                let (s, c) = angle.sin_cos();
                let u = c * dx + s * dy;
                let v = -s * dx + c * dy;
                p.values[y * w + x] = 0.5
                    + 0.2 * (0.35 * u + 0.2 * v).sin()
                    + 0.2 * (0.3 * v - 0.15 * u + 1.0).cos()
                    + 0.01 * u;
            }
        }
        p
    }

    #[test]
    fn a_turned_and_scaled_patch_has_the_same_descriptor_and_a_turned_angle() {
        let straight = pattern(0.0, 1.0);
        let mut a = Gradients::of_image(&straight, |_, _| true);
        let o = dominant_orientations(&mut a, 60.0, 60.0, 3.0)[0];
        let da = descriptor_at(&mut a, 60.0, 60.0, 3.0, o).unwrap();
        for (turn, scale) in [(0.7f32, 1.0f32), (-1.9, 1.3), (3.0, 0.8)] {
            let turned = pattern(turn, scale);
            let mut b = Gradients::of_image(&turned, |_, _| true);
            let p = dominant_orientations(&mut b, 60.0, 60.0, 3.0 * scale)[0];
            let difference = (p - o - turn).rem_euclid(TAU);
            assert!(difference.min(TAU - difference) < 0.06, "{difference}");
            let db = descriptor_at(&mut b, 60.0, 60.0, 3.0 * scale, p).unwrap();
            assert!(similarity(&da, &db) > 0.97, "{}", similarity(&da, &db));
        }
        let other = descriptor_at(&mut a, 40.0, 75.0, 3.0, o).unwrap();
        assert!(similarity(&da, &other) < 0.95);
    }

    #[test]
    fn descriptors_have_unit_length_and_a_plain_patch_has_none() {
        let image = pattern(0.3, 1.0);
        let mut a = Gradients::of_image(&image, |_, _| true);
        let d = descriptor_at(&mut a, 50.0, 60.0, 2.0, 0.1).unwrap();
        assert!((similarity(&d, &d) - 1.0).abs() < 2e-3);
        let image = FloatImage::zeros(50, 50);
        let mut plain = Gradients::of_image(&image, |_, _| true);
        assert!(descriptor_at(&mut plain, 25.0, 25.0, 2.0, 0.0).is_none());
        assert!(dominant_orientations(&mut plain, 25.0, 25.0, 2.0).is_empty());
    }

    #[test]
    fn pixels_that_are_not_kept_do_not_count() {
        let image = pattern(0.0, 1.0);
        let mut spoiled = image.clone();
        (0..121 * 121)
            .filter(|i| i % 121 > 70)
            .for_each(|i| spoiled.values[i] = if i % 2 == 0 { 1.0 } else { 0.0 });
        let keep = |x: usize, _: usize| x < 69;
        let mut a = Gradients::of_image(&image, keep);
        let mut b = Gradients::of_image(&spoiled, keep);
        assert_eq!(descriptor_at(&mut a, 60.0, 60.0, 3.0, 0.5), descriptor_at(&mut b, 60.0, 60.0, 3.0, 0.5));
    }
}
