//! Orientation and description of image features: gradient histograms (Lowe, IJCV 2004, sections 5 and 6)
//! compared by the Hellinger kernel (Arandjelovic and Zisserman, "Three things everyone should know...", CVPR
//! 2012).

use std::f32::consts::TAU;

use crate::capture::features::scale_space::Plane;

/// Numbers in a descriptor: 4 x 4 cells of 8 gradient directions.
pub const DESCRIPTOR_LENGTH: usize = 128;
/// Length of every descriptor as a vector; derived: its square is 2^24, so that single floats hold inner
/// products exactly.
pub const DESCRIPTOR_NORM: f32 = 4096.0;

/// A unit vector scaled by [`DESCRIPTOR_NORM`] and rounded.
pub type Descriptor = [i16; DESCRIPTOR_LENGTH];

/// Bins of the orientation histogram.
const ORIENTATIONS: usize = 36;
/// Cells along one side of the descriptor.
const CELLS: usize = 4;
/// Directions in a cell.
const DIRECTIONS: usize = 8;

/// Gradient magnitude and direction (radians in `[0, 2 pi)`, counter-clockwise with y down) of pixels: of
/// those that were asked for, as most lie near no feature.
pub(crate) struct Gradients<'a, K> {
    image: &'a Plane,
    keep: K,
    /// The magnitude is 0 until it is asked for: memory of zeros costs nothing where nobody looks.
    polar: Vec<[f32; 2]>,
}

impl<'a, K: Fn(usize, usize) -> bool> Gradients<'a, K> {
    /// Central differences; pixels where `keep` says no, and the border, have magnitude 0.
    pub fn of(image: &'a Plane, keep: K) -> Self {
        Self { image, keep, polar: vec![[0.0; 2]; image.width * image.height] }
    }

    fn polar(&self, x: usize, y: usize) -> [f32; 2] {
        let image = self.image;
        let is_inner = x > 0 && y > 0 && x + 1 < image.width && y + 1 < image.height;
        if !(is_inner && (self.keep)(x, y)) {
            return [0.0; 2];
        }
        let (dx, dy) = (image.at(x + 1, y) - image.at(x - 1, y), image.at(x, y + 1) - image.at(x, y - 1));
        [(dx * dx + dy * dy).sqrt(), in_circle(dy.atan2(dx))]
    }

    /// Visits the pixels within `radius` of a point: offset x, offset y, magnitude less by a Gaussian of the
    /// given standard deviation about the point, direction.
    fn around(&mut self, x: f32, y: f32, radius: f32, sigma: f32, mut visit: impl FnMut(f32, f32, f32, f32)) {
        let range = |c: f32, n: usize| {
            ((c - radius).ceil().max(0.0) as usize)..((c + radius).floor().max(0.0) as usize + 1).min(n)
        };
        // The Gaussian of a row by that of a column: few exponentials.
        let share = |offset: f32| (-offset * offset / (2.0 * sigma * sigma)).exp();
        let columns: Vec<(usize, f32)> =
            range(x, self.image.width).map(|px| (px, share(px as f32 - x))).collect();
        for py in range(y, self.image.height) {
            let of_row = share(py as f32 - y);
            for &(px, of_column) in &columns {
                let i = py * self.image.width + px;
                if self.polar[i][0] == 0.0 {
                    self.polar[i] = self.polar(px, py);
                }
                let [magnitude, direction] = self.polar[i];
                if magnitude > 0.0 {
                    visit(px as f32 - x, py as f32 - y, magnitude * of_row * of_column, direction);
                }
            }
        }
    }
}

/// An angle in `(-2 pi, 4 pi)` brought to `[0, 2 pi)`, without a division.
fn in_circle(angle_rad: f32) -> f32 {
    match angle_rad {
        a if a < 0.0 => a + TAU,
        a if a >= TAU => a - TAU,
        a => a,
    }
}

/// Dominant gradient directions around a point, radians, strongest first; at most 3.
pub(crate) fn orientations(
    gradients: &mut Gradients<'_, impl Fn(usize, usize) -> bool>,
    x: f32,
    y: f32,
    scale_px: f32,
) -> Vec<f32> {
    // Lowe's section 5: a window of 1.5 scales, peaks from 80 % of the highest.
    let sigma = 1.5 * scale_px;
    let mut histogram = [0.0f32; ORIENTATIONS];
    gradients.around(x, y, 3.0 * sigma, sigma, |_, _, weight, direction| {
        let bin = direction / TAU * ORIENTATIONS as f32;
        let (low, fraction) = (bin.floor(), bin - bin.floor());
        histogram[low as usize % ORIENTATIONS] += weight * (1.0 - fraction);
        histogram[(low as usize + 1) % ORIENTATIONS] += weight * fraction;
    });
    // Smoothed, so that noise makes no second peak beside the first.
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
        let (l, c, r) = (
            histogram[(i + ORIENTATIONS - 1) % ORIENTATIONS],
            histogram[i],
            histogram[(i + 1) % ORIENTATIONS],
        );
        if c > 0.0 && c >= 0.8 * highest && c > l && c >= r {
            // The peak of the parabola through three bins.
            let shift = 0.5 * (l - r) / (l - 2.0 * c + r).min(-1e-12);
            peaks.push((c, ((i as f32 + shift) / ORIENTATIONS as f32 * TAU).rem_euclid(TAU)));
        }
    }
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
    peaks.into_iter().take(3).map(|p| p.1).collect()
}

/// The descriptor of the square of side 12 `scale_px` about a point, turned by `angle_rad`; `None` without
/// gradients.
pub(crate) fn describe(
    gradients: &mut Gradients<'_, impl Fn(usize, usize) -> bool>,
    x: f32,
    y: f32,
    scale_px: f32,
    angle_rad: f32,
) -> Option<Descriptor> {
    const SIDE: usize = CELLS + 2;
    let mut cells = [[[0.0f32; DIRECTIONS]; SIDE]; SIDE];
    let cell_px = 3.0 * scale_px;
    let (sin, cos) = angle_rad.sin_cos();
    let half = 0.5 * CELLS as f32;
    let radius = cell_px * std::f32::consts::SQRT_2 * (half + 0.5);
    gradients.around(x, y, radius, half * cell_px, |dx, dy, weight, direction| {
        let (u, v) = ((cos * dx + sin * dy) / cell_px, (-sin * dx + cos * dy) / cell_px);
        // Cell coordinates with a border cell on each side: the center of inner cell 0 is at 1.
        let (cu, cv) = (u + half + 0.5, v + half + 0.5);
        let top = (SIDE - 1) as f32;
        if !(cu > 0.0 && cu < top && cv > 0.0 && cv < top) {
            return;
        }
        let bin = in_circle(direction - angle_rad) / TAU * DIRECTIONS as f32;
        // Spread over the eight nearest bins, so that a small shift changes the descriptor little.
        let (iu, iv, ib) = (cu as usize, cv as usize, bin as usize);
        let (fu, fv, fb) = (cu - iu as f32, cv - iv as f32, bin - ib as f32);
        for (j, wv) in [(iv, 1.0 - fv), (iv + 1, fv)] {
            for (i, wu) in [(iu, 1.0 - fu), (iu + 1, fu)] {
                let w = weight * wu * wv;
                cells[j][i][ib % DIRECTIONS] += w * (1.0 - fb);
                cells[j][i][(ib + 1) % DIRECTIONS] += w * fb;
            }
        }
    });
    let mut values = [0.0f32; DESCRIPTOR_LENGTH];
    for j in 0..CELLS {
        for i in 0..CELLS {
            let at = (j * CELLS + i) * DIRECTIONS;
            values[at..at + DIRECTIONS].copy_from_slice(&cells[j + 1][i + 1]);
        }
    }
    hellinger(&mut values)
}

/// Clips strong gradients at 0.2 of the vector's length, divides by the sum and takes square roots.
fn hellinger(values: &mut [f32; DESCRIPTOR_LENGTH]) -> Option<Descriptor> {
    let norm = values.iter().map(|v| v * v).sum::<f32>().sqrt();
    if norm < 1e-6 {
        return None;
    }
    // A strong edge, which light changes most, must not decide the descriptor alone (Lowe's section 6.1).
    values.iter_mut().for_each(|v| *v = (*v / norm).min(0.2));
    let sum = values.iter().sum::<f32>();
    // Square roots of what sums to 1 have length 1: docs/method.md (4.1).
    Some(values.map(|v| ((v / sum).sqrt() * DESCRIPTOR_NORM).round() as i16))
}

/// Inner product; at most `DESCRIPTOR_NORM^2` up to rounding, so it fits.
#[inline]
pub(crate) fn dot(a: &Descriptor, b: &Descriptor) -> i32 {
    a.iter().zip(b).map(|(&p, &q)| i32::from(p) * i32::from(q)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cosine between two descriptors, in `[0, 1]`.
    fn similarity(a: &Descriptor, b: &Descriptor) -> f32 {
        dot(a, b) as f32 / (DESCRIPTOR_NORM * DESCRIPTOR_NORM)
    }

    /// A smooth pattern sampled about a center, turned by `angle` and scaled.
    fn pattern(angle: f32, scale: f32) -> Plane {
        let (w, h) = (121, 121);
        let mut p = Plane::zeros(w, h);
        for y in 0..h {
            for x in 0..w {
                let (dx, dy) = ((x as f32 - 60.0) / scale, (y as f32 - 60.0) / scale);
                let (s, c) = angle.sin_cos();
                let (u, v) = (c * dx + s * dy, -s * dx + c * dy);
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
        let mut a = Gradients::of(&straight, |_, _| true);
        let o = orientations(&mut a, 60.0, 60.0, 3.0)[0];
        let da = describe(&mut a, 60.0, 60.0, 3.0, o).unwrap();
        for (turn, scale) in [(0.7f32, 1.0f32), (-1.9, 1.3), (3.0, 0.8)] {
            let turned = pattern(turn, scale);
            let mut b = Gradients::of(&turned, |_, _| true);
            let p = orientations(&mut b, 60.0, 60.0, 3.0 * scale)[0];
            let difference = (p - o - turn).rem_euclid(TAU);
            assert!(difference.min(TAU - difference) < 0.06, "{difference}");
            let db = describe(&mut b, 60.0, 60.0, 3.0 * scale, p).unwrap();
            assert!(similarity(&da, &db) > 0.97, "{}", similarity(&da, &db));
        }
        let other = describe(&mut a, 40.0, 75.0, 3.0, o).unwrap();
        assert!(similarity(&da, &other) < 0.95);
    }

    #[test]
    fn descriptors_have_unit_length_and_a_plain_patch_has_none() {
        let image = pattern(0.3, 1.0);
        let mut a = Gradients::of(&image, |_, _| true);
        let d = describe(&mut a, 50.0, 60.0, 2.0, 0.1).unwrap();
        assert!((similarity(&d, &d) - 1.0).abs() < 2e-3);
        let image = Plane::zeros(50, 50);
        let mut plain = Gradients::of(&image, |_, _| true);
        assert!(describe(&mut plain, 25.0, 25.0, 2.0, 0.0).is_none());
        assert!(orientations(&mut plain, 25.0, 25.0, 2.0).is_empty());
    }

    #[test]
    fn pixels_that_are_not_kept_do_not_count() {
        let image = pattern(0.0, 1.0);
        let mut spoiled = image.clone();
        (0..121 * 121)
            .filter(|i| i % 121 > 70)
            .for_each(|i| spoiled.values[i] = if i % 2 == 0 { 1.0 } else { 0.0 });
        let keep = |x: usize, _: usize| x < 69;
        let (mut a, mut b) = (Gradients::of(&image, keep), Gradients::of(&spoiled, keep));
        assert_eq!(describe(&mut a, 60.0, 60.0, 3.0, 0.5), describe(&mut b, 60.0, 60.0, 3.0, 0.5));
    }
}
