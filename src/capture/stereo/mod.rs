//! Multi-view stereo from color where the sensor read no depth: dark, glossy and thin parts of the object.
//!
//! Each cell (2 x 2 pixels) of a hole in depth gets a plane, initially from the nearest reading. Planes are
//! propagated between neighbors and perturbed; the plane with the best photo-consistency remains (PatchMatch:
//! Bleyer, Rhemann and Rother 2011; multi-view: Galliani, Lasinger and Schindler 2015). A depth is used if
//! other views find the same. See docs/method.md 2.16.

mod agreement;
mod cells;
mod likeness;
mod planes;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use self::{
    agreement::{agreed_cells, relative_spread},
    cells::Cells,
    likeness::{REACH, compared_views},
    planes::{Planes, propagated_planes},
};
use super::{NoiseConfig, RgbdFrame};
use common::stop::{Stop, Stopped};

/// Least and largest weight of a depth from color, in sensor readings.
/// chosen: neighbors share their color patch, so a pixel never counts more than one reading; the lower bound
/// is that of [`RgbdFrame::sigma_m`]
const READINGS: [f64; 2] = [1e-3, 1.0];

/// Whether missing depth on the object is filled from color.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum UseColorDepth {
    /// Where holes are wider than shadows and edges cause.
    #[default]
    Auto,
    /// Wherever depth is missing.
    Always,
    /// Depth comes from the sensor only.
    Never,
}

/// Least share of the object's cells far from any reading (beyond a patch's reach) for depth from color.
/// measured: at most 2.3 % in seven clean rendered objects, at least 9.5 % in four with lacquer on three
/// tenths (docs/figures.md)
const MUCH_UNREAD: f64 = 0.05;
/// Stride of the views that are sampled for this share.
/// derived: consecutive views show the same
const ASKED: usize = 5;

/// Share of the object's cells further than [`REACH`] from any reading of it, over sampled views.
fn unread_share(frames: &[RgbdFrame], noise: &NoiseConfig, stop: &Stop) -> Result<f64, Stopped> {
    let asked: Vec<&RgbdFrame> = frames.iter().step_by(ASKED).collect();
    let counts: Vec<[usize; 2]> = asked
        .par_iter()
        .map(|frame| stop.check().map(|()| Cells::of_frame(frame, noise).unread_counts(REACH as usize)))
        .collect::<Result<_, Stopped>>()?;
    let sum = |k: usize| counts.iter().map(|count| count[k]).sum::<usize>();
    Ok(sum(1) as f64 / sum(0).max(1) as f64)
}

/// Result of filling depth from color.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ColorDepth {
    /// Share of the object's cells far from any reading.
    pub unread: f64,
    /// Number of object pixels without depth.
    pub holes: usize,
    /// Number of them that were filled.
    pub filled: usize,
    /// Relative standard deviation of a filled depth, from the differences between views; 0 where none was
    /// filled.
    pub relative_sigma: f64,
}

/// Fills holes on the object by multi-view stereo over the views of one state, and sets these pixels'
/// `readings` by the spread between views. Measured depth remains. The masks must come from the recording:
/// otherwise pixels without depth may show anything. `None` where filling is not needed.
///
/// # Errors
/// [`Stopped`].
pub fn fill_from_color(
    frames: &mut [RgbdFrame],
    noise: &NoiseConfig,
    when: UseColorDepth,
    seed: u64,
    stop: &Stop,
) -> Result<Option<ColorDepth>, Stopped> {
    if when == UseColorDepth::Never {
        return Ok(None);
    }
    let unread = unread_share(frames, noise, stop)?;
    if when == UseColorDepth::Auto && unread <= MUCH_UNREAD {
        return Ok(None);
    }
    let views: Vec<Cells> = frames
        .par_iter()
        .map(|frame| stop.check().map(|()| Cells::of_frame(frame, noise)))
        .collect::<Result<_, Stopped>>()?;
    let planes: Vec<Planes> = (0..views.len())
        .into_par_iter()
        .map(|i| propagated_planes(&views[i], &compared_views(&views, i), seed.wrapping_add(i as u64), stop))
        .collect::<Result<_, Stopped>>()?;
    let agreed: Vec<Vec<bool>> = (0..views.len())
        .into_par_iter()
        .map(|i| stop.check().map(|()| agreed_cells(&views, &planes, i)))
        .collect::<Result<_, Stopped>>()?;
    let relative_sigma = relative_spread(&views, &planes, &agreed, stop)?;
    let filled: usize = frames
        .par_iter_mut()
        .zip(&views)
        .zip(planes.par_iter().zip(&agreed))
        .map(|((frame, view), (planes, agreed))| {
            fill_from_view(frame, view, planes, agreed, relative_sigma, noise)
        })
        .sum();
    let holes = views.iter().map(|view| 4 * view.hole.iter().filter(|h| **h).count()).sum();
    Ok(Some(ColorDepth { unread, holes, filled, relative_sigma }))
}

/// Writes the agreed depths of a view into pixels without depth.
fn fill_from_view(
    frame: &mut RgbdFrame,
    view: &Cells,
    planes: &Planes,
    agreed: &[bool],
    relative_sigma: f64,
    noise: &NoiseConfig,
) -> usize {
    let width = frame.intrinsics.width;
    if frame.readings.is_empty() {
        frame.readings = vec![1.0; frame.depth_m.len()];
    }
    let mut filled = 0;
    for cell in (0..agreed.len()).filter(|&c| agreed[c]) {
        for pixel in view.pixels_of_cell(cell, width) {
            let ray = frame.intrinsics.ray_at((pixel % width) as f64, (pixel / width) as f64);
            let inverse = planes.at[cell].dot(&ray.cast());
            if frame.depth_m[pixel] > 0.0 || inverse <= 0.0 {
                continue;
            }
            let depth_m = f64::from(1.0 / inverse);
            let ratio = noise.sigma_m(depth_m) / (relative_sigma * depth_m);
            frame.depth_m[pixel] = depth_m as f32;
            frame.readings[pixel] = ratio.powi(2).clamp(READINGS[0], READINGS[1]) as f32;
            filled += 1;
        }
    }
    filled
}

#[cfg(test)]
mod tests;
