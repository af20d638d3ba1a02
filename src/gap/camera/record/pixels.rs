//! The compared pixels of the frames.

use rayon::prelude::*;

use crate::camera::record::frames::FrameRun;
use capture::pixel_weights;

/// Approximate number of compared pixels of the object in a frame.
const SAMPLES: usize = 2500;
/// Pixels within this many of an outline are not compared.
pub const BORDER: usize = 2;

/// The compared pixels of every frame; the same for all hypotheses.
pub struct Pixels {
    /// Sampled pixel indices with a reading on the object, by run and frame.
    pub object: Vec<Vec<Vec<usize>>>,
    /// Sampled pixel indices off the object, by run and frame.
    pub empty: Vec<Vec<Vec<usize>>>,
    /// Side of the sampling grid, by run and frame.
    pub stride: Vec<Vec<usize>>,
}

impl Pixels {
    /// Chooses pixels on a grid, away from depth edges and from the mask's border.
    pub fn chosen_of(runs: &[FrameRun]) -> Self {
        let mut pixels = Self { object: Vec::new(), empty: Vec::new(), stride: Vec::new() };
        for run in runs {
            let chosen: Vec<_> = run.frames.par_iter().map(|f| chosen_pixels(f, run)).collect();
            let mut object = Vec::new();
            let mut empty = Vec::new();
            let mut stride = Vec::new();
            for (o, e, s) in chosen {
                object.push(o);
                empty.push(e);
                stride.push(s);
            }
            pixels.object.push(object);
            pixels.empty.push(empty);
            pixels.stride.push(stride);
        }
        pixels
    }

    /// Spacing of the sampling grid of a frame, pixels.
    pub fn stride_of(&self, run: usize, frame: usize) -> usize {
        self.stride[run][frame]
    }
}

fn chosen_pixels(frame: &capture::RgbdFrame, run: &FrameRun) -> (Vec<usize>, Vec<usize>, usize) {
    let w = frame.intrinsics.width;
    let h = frame.intrinsics.height;
    let weights = pixel_weights(frame, &run.noise);
    let usable = |i: usize| weights[i] > 0.0 && frame.is_object(i);
    let count = (0..w * h).filter(|&i| usable(i)).count();
    let stride = ((count as f64 / SAMPLES as f64).sqrt().round() as usize).max(1);
    let grid = (0..h).step_by(stride).flat_map(|y| (0..w).step_by(stride).map(move |x| y * w + x));
    let object = grid.clone().filter(|&i| usable(i)).collect();
    // Without a mask no pixel is known to be off the object.
    let off = grid.filter(|_| frame.mask.is_some());
    let empty = off.filter(|&i| pixels_around(i, w, h).all(|n| !frame.is_object(n))).collect();
    (object, empty, stride)
}

/// Pixels within `BORDER` of a pixel, itself included.
pub fn pixels_around(i: usize, w: usize, h: usize) -> impl Iterator<Item = usize> {
    let x = i % w;
    let y = i / w;
    let columns = x.saturating_sub(BORDER)..=(x + BORDER).min(w - 1);
    let rows = y.saturating_sub(BORDER)..=(y + BORDER).min(h - 1);
    rows.flat_map(move |y| columns.clone().map(move |x| y * w + x))
}
