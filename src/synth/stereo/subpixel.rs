//! Disparities refined on the images themselves: least squares over a window (Lucas and Kanade 1981).

use rayon::prelude::*;

/// Sides of the windows, pixels: the small one, and one for places with too little texture in it.
const SMALL: usize = 7;
const LARGE: usize = 11;
/// Steps of Gauss and Newton.
const STEPS: usize = 3;
/// Farthest way from the disparity at the start, pixels. chosen: beyond it, another dot would match
const FARTHEST_PX: f32 = 1.0;
/// Least mean of squared gradients over a window, gray levels squared.
/// chosen: above the noise of a dark surface
const LEAST_TEXTURE: f32 = 4.0;

/// Refines disparities in place; those without texture become `NAN`. Near the border they stay as they are.
pub(super) fn refine_disparities(left: &[u8], right: &[u8], width: usize, disparity: &mut [f32]) {
    let height = left.len() / width;
    let border = LARGE / 2;
    disparity.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        if y < border || y + border >= height {
            return;
        }
        for x in border + 1..width - border - 1 {
            if row[x].is_finite() {
                let small =
                    || Window::<SMALL>::at(left, width, [x, y])?.refined(right, width, [x, y], row[x]);
                let large =
                    || Window::<LARGE>::at(left, width, [x, y])?.refined(right, width, [x, y], row[x]);
                row[x] = small().or_else(large).unwrap_or(f32::NAN);
            }
        }
    });
}

/// A window of the left image: gray levels and horizontal gradients, each less their mean.
struct Window<const SIDE: usize> {
    gray: [[f32; SIDE]; SIDE],
    gradient: [[f32; SIDE]; SIDE],
    /// Sum of the squared gradients.
    texture: f32,
}

impl<const SIDE: usize> Window<SIDE> {
    /// The window around a pixel; `None` without texture.
    fn at(left: &[u8], width: usize, [x, y]: [usize; 2]) -> Option<Self> {
        let mut gray = [[0.0; SIDE]; SIDE];
        let mut gradient = [[0.0; SIDE]; SIDE];
        for j in 0..SIDE {
            let row = &left[(y + j - SIDE / 2) * width + x - SIDE / 2 - 1..][..SIDE + 2];
            for i in 0..SIDE {
                gray[j][i] = f32::from(row[i + 1]);
                gradient[j][i] = 0.5 * (f32::from(row[i + 2]) - f32::from(row[i]));
            }
        }
        subtract_mean(&mut gray);
        subtract_mean(&mut gradient);
        let texture: f32 = gradient.iter().flatten().map(|g| g * g).sum();
        (texture >= LEAST_TEXTURE * (SIDE * SIDE) as f32).then_some(Self { gray, gradient, texture })
    }

    /// The disparity at which the right image's window differs least from this one; that at the start if the
    /// search leaves it. `None` across the border.
    fn refined(&self, right: &[u8], width: usize, at: [usize; 2], start_px: f32) -> Option<f32> {
        let mut disparity = start_px;
        for _ in 0..STEPS {
            let mut other = shifted_window::<SIDE>(right, width, at, disparity)?;
            subtract_mean(&mut other);
            let mut slope = 0.0;
            for j in 0..SIDE {
                for i in 0..SIDE {
                    slope += self.gradient[j][i] * (other[j][i] - self.gray[j][i]);
                }
            }
            // right(x - d) has the derivative -gradient with respect to d.
            disparity += slope / self.texture;
            if (disparity - start_px).abs() > FARTHEST_PX {
                return Some(start_px);
            }
        }
        Some(disparity)
    }
}

fn subtract_mean<const SIDE: usize>(values: &mut [[f32; SIDE]; SIDE]) {
    let mean = values.iter().flatten().sum::<f32>() / (SIDE * SIDE) as f32;
    values.iter_mut().flatten().for_each(|v| *v -= mean);
}

/// The right image's window at a disparity, interpolated along rows by cubics (Catmull and Rom 1974); `None`
/// across the border.
fn shifted_window<const SIDE: usize>(
    right: &[u8],
    width: usize,
    [x, y]: [usize; 2],
    disparity: f32,
) -> Option<[[f32; SIDE]; SIDE]> {
    let first = (x - SIDE / 2) as f32 - disparity;
    let column = first.floor();
    if !(column >= 1.0 && column as usize + SIDE + 2 <= width) {
        return None;
    }
    let t = first - column;
    let weights = [
        0.5 * t * (t * (2.0 - t) - 1.0),
        0.5 * (t * t * (3.0 * t - 5.0) + 2.0),
        0.5 * t * (t * (4.0 - 3.0 * t) + 1.0),
        0.5 * t * t * (t - 1.0),
    ];
    let mut window = [[0.0; SIDE]; SIDE];
    for j in 0..SIDE {
        let row = &right[(y + j - SIDE / 2) * width + column as usize - 1..][..SIDE + 3];
        for i in 0..SIDE {
            window[j][i] = (0..4).map(|k| weights[k] * f32::from(row[i + k])).sum();
        }
    }
    Some(window)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shifted_texture_is_found_to_a_fiftieth_of_a_pixel() {
        let width = 120;
        let image = |shift: f64| -> Vec<u8> {
            let value = |i: usize| {
                let x = (i % width) as f64 + shift;
                let y = (i / width) as f64;
                120.0 + 60.0 * (0.9 * x + 0.4 * y).sin() + 40.0 * (0.37 * x - 0.8 * y).cos()
            };
            (0..width * 40).map(|i| value(i).round() as u8).collect()
        };
        for true_px in [10.0, 10.3, 10.5, 10.75] {
            let mut disparity = vec![10.4; width * 40];
            refine_disparities(&image(0.0), &image(true_px), width, &mut disparity);
            for x in 30..110 {
                let off = f64::from(disparity[20 * width + x]) - true_px;
                assert!(off.abs() < 0.02, "{true_px} {x} {off}");
            }
        }
    }
}
