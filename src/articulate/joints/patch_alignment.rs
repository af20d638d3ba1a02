//! Finds a patch of gray values in a larger one.

use nalgebra::{Matrix2, Vector2};

/// Share of the least contrast below which no alignment can succeed.
///
/// chosen: the rest is rounding, left to the alignment
const SURELY_PLAIN: f64 = 0.99;
/// A step shorter than this ends the search, patch samples.
///
/// chosen: below the shift of a patch by noise of gray values
const FOUND_SAMPLES: f64 = 0.02;
/// Oscillating steps below this also end the search, patch samples.
///
/// chosen: a tenth of a sample
const TO_AND_FRO_SAMPLES: f64 = 0.1;
/// Samples on each side of a patch's center.
pub(crate) const RADIUS: i32 = 4;
/// Largest shift, in patch samples.
pub(crate) const REACH: i32 = 4;
/// Lucas-Kanade iterations.
const ITERATIONS: usize = 12;
/// Least seen share of a patch.
///
/// tuned: shared/bags
const MIN_SEEN: f64 = 0.9;

/// Gray values on a square of `2 radius + 1` samples a side; NaN where no frame saw the surface.
pub(crate) struct GrayPatch {
    pub radius: i32,
    pub values: Vec<f32>,
}

impl GrayPatch {
    fn at(&self, u: i32, v: i32) -> f32 {
        let side = 2 * self.radius + 1;
        self.values[((v + self.radius) * side + u + self.radius) as usize]
    }

    /// Bilinear value; NaN outside or where a neighbor was not seen.
    fn bilinear_value(&self, u: f64, v: f64) -> f64 {
        let x = u.floor() as i32;
        let y = v.floor() as i32;
        if x < -self.radius || y < -self.radius || x >= self.radius || y >= self.radius {
            return f64::NAN;
        }
        let a = u - f64::from(x);
        let b = v - f64::from(y);
        let [f00, f10, f01, f11] =
            [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| f64::from(self.at(x + i, y + j)));
        (f00 * (1.0 - a) + f10 * a) * (1.0 - b) + (f01 * (1.0 - a) + f11 * a) * b
    }

    /// Whether [`aligned_shift`] cannot find a reference anywhere, because too little of it is seen or it is
    /// too plain. The alignment compares at least [`MIN_SEEN`] of it, whose sum of squared deviations is at
    /// most that of all.
    pub(crate) fn is_lost(&self, min_contrast: f64) -> bool {
        let seen = self.values.iter().filter(|v| v.is_finite()).map(|v| f64::from(*v));
        let count = seen.clone().count() as f64;
        let least = MIN_SEEN * self.values.len() as f64;
        let mean = seen.clone().sum::<f64>() / count;
        let squares: f64 = seen.map(|v| (v - mean).powi(2)).sum();
        count < least || squares < SURELY_PLAIN * least * min_contrast * min_contrast
    }
}

/// Where a patch was found in a larger one.
pub(crate) struct Shift {
    /// Shift along the two tangents, patch samples.
    pub shift: Vector2<f64>,
    pub covariance: Matrix2<f64>,
    /// Normalized correlation there.
    pub correlation: f64,
}

/// A sample of a patch, the corresponding sample of the other patch, and the gradient there.
type Row = (f64, f64, Vector2<f64>);

/// Looks for a patch in a larger one (Lucas and Kanade 1981). `None` without contrast, outside the reach, or
/// if the search does not converge. See docs/method.md (8.6).
pub(crate) fn aligned_shift(reference: &GrayPatch, target: &GrayPatch, min_contrast: f64) -> Option<Shift> {
    let mut shift = Vector2::zeros();
    let mut last: Option<Shift> = None;
    for _ in 0..ITERATIONS {
        let (step, covariance, correlation) =
            alignment_step(&seen_rows(reference, target, &shift), min_contrast)?;
        last = Some(Shift { shift, covariance, correlation });
        // The image's slope is valid for about a sample.
        shift += step.map(|s| s.clamp(-1.0, 1.0));
        // Beyond this, the slopes at the patch's border would read outside the larger patch.
        if shift.amax() > f64::from(REACH - 1) {
            return None;
        }
        if step.norm() < FOUND_SAMPLES {
            return last;
        }
    }
    last.filter(|last| (last.shift - shift).norm() < TO_AND_FRO_SAMPLES)
}

/// The samples seen in both patches.
fn seen_rows(reference: &GrayPatch, target: &GrayPatch, shift: &Vector2<f64>) -> Vec<Row> {
    let mut rows = Vec::new();
    for v in -RADIUS..=RADIUS {
        for u in -RADIUS..=RADIUS {
            let x = f64::from(u) + shift.x;
            let y = f64::from(v) + shift.y;
            let a = f64::from(reference.at(u, v));
            let b = target.bilinear_value(x, y);
            let gradient = Vector2::new(
                target.bilinear_value(x + 0.5, y) - target.bilinear_value(x - 0.5, y),
                target.bilinear_value(x, y + 0.5) - target.bilinear_value(x, y - 0.5),
            );
            if a.is_finite() && b.is_finite() && gradient.x.is_finite() && gradient.y.is_finite() {
                rows.push((a, b, gradient));
            }
        }
    }
    rows
}

/// A step of the shift, its covariance, and the correlation before it; `None` where too little is seen or the
/// patch is plain.
fn alignment_step(rows: &[Row], min_contrast: f64) -> Option<(Vector2<f64>, Matrix2<f64>, f64)> {
    let n = rows.len() as f64;
    if n < MIN_SEEN * f64::from((2 * RADIUS + 1).pow(2)) {
        return None;
    }
    let (ma, mb) = (rows.iter().map(|r| r.0).sum::<f64>() / n, rows.iter().map(|r| r.1).sum::<f64>() / n);
    let sa = (rows.iter().map(|r| (r.0 - ma).powi(2)).sum::<f64>() / n).sqrt();
    let sb = (rows.iter().map(|r| (r.1 - mb).powi(2)).sum::<f64>() / n).sqrt();
    if sa < min_contrast || sb < min_contrast {
        return None;
    }
    let mut h = Matrix2::zeros();
    let mut g = Vector2::zeros();
    let mut square = 0.0;
    let mut product = 0.0;
    for (a, b, d) in rows {
        // Light may have changed with the normal, so brightness and contrast of both patches are equalised.
        let a = (a - ma) / sa;
        let b = (b - mb) / sb;
        let d = d / sb;
        h += d * d.transpose();
        g += d * (a - b);
        square += (a - b) * (a - b);
        product += a * b;
    }
    let inverse = h.try_inverse()?;
    Some((inverse * g, inverse * (square / n), product / n))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texture(u: f64, v: f64) -> f32 {
        (0.5 + 0.2 * (0.55 * u + 0.2 * v).sin() + 0.2 * (0.5 * v - 0.3 * u + 1.0).cos()) as f32
    }

    fn patch(radius: i32, f: impl Fn(f64, f64) -> f32) -> GrayPatch {
        let values = (-radius..=radius)
            .flat_map(|v| (-radius..=radius).map(move |u| (u, v)))
            .map(|(u, v)| f(f64::from(u), f64::from(v)))
            .collect();
        GrayPatch { radius, values }
    }

    #[test]
    fn a_shifted_and_dimmed_patch_is_found() {
        for (du, dv) in [(0.0, 0.0), (1.3, -0.7), (-2.2, 1.9)] {
            let reference = patch(RADIUS, texture);
            let target = patch(RADIUS + REACH, |u, v| 0.1 + 0.6 * texture(u - du, v - dv));
            let found = aligned_shift(&reference, &target, 0.01).unwrap();
            assert!((found.shift - Vector2::new(du, dv)).norm() < 0.1, "{}", found.shift);
            assert!(found.correlation > 0.98);
        }
    }

    #[test]
    fn what_is_lost_is_not_found_wherever_it_is_looked_for() {
        let mut lost = 0;
        for k in 0..400 {
            let t = f64::from(k);
            // Contrast about the least, and up to a tenth and a little more of the patch unseen.
            let gray = |u: f64, v: f64| {
                let hidden = (u - 3.0 * v + t).rem_euclid(400.0 / (t % 43.0 + 1.0)) < 1.0;
                if hidden { f32::NAN } else { 0.5 + (0.02 + 0.0001 * t as f32) * (texture(u, v) - 0.5) }
            };
            let reference = patch(RADIUS, gray);
            if reference.is_lost(0.006) {
                lost += 1;
                let target = patch(RADIUS + REACH, |u, v| texture(u - 0.3, v + 0.2));
                assert!(aligned_shift(&reference, &target, 0.006).is_none(), "{k}");
            }
        }
        assert!(lost > 50 && lost < 350, "{lost}");
    }

    #[test]
    fn a_plain_patch_and_an_unseen_one_are_not_found() {
        let plain = patch(RADIUS + REACH, |_, _| 0.4);
        assert!(aligned_shift(&patch(RADIUS, |_, _| 0.4), &plain, 0.01).is_none());
        let hidden = patch(RADIUS + REACH, |u, v| if u > 0.0 { f32::NAN } else { texture(u, v) });
        assert!(aligned_shift(&patch(RADIUS, texture), &hidden, 0.01).is_none());
    }
}
