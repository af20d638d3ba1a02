//! Depth from color where the sensor read none: dark, glossy and thin parts of the object.
//!
//! In every view each cell (2 x 2 pixels) of a hole gets a plane, at first from the nearest reading. Planes
//! pass from neighbor to neighbor and are perturbed, and the plane with the most alike other views stays
//! (PatchMatch: Bleyer, Rhemann and Rother 2011; many views: Galliani, Lasinger and Schindler 2015). A depth
//! counts where other views find the same. See docs/method.md 2.16.

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

/// Most and fewest readings of the sensor in place of a depth by color.
/// chosen: neighbors share their patch of color, so one pixel is never worth more than a reading; the lower
/// bound is that of [`RgbdFrame::sigma_m`].
const READINGS: [f64; 2] = [1e-3, 1.0];

/// Whether the sensor's missing depth on the object is taken from color.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum UseColorDepth {
    /// Where holes are wider than shadows and edges make them.
    #[default]
    Auto,
    /// Wherever depth is missing.
    Always,
    /// Depth is the sensor's alone.
    Never,
}

/// Least share of the object's cells beyond a patch's reach of any reading for depth from color.
/// measured: seven clean rendered objects have 2.3 % at most, four made ones with lacquer on three tenths
/// 9.5 % at least (docs/figures.md).
const MUCH_UNREAD: f64 = 0.05;
/// Stride of views for this share.
/// derived: neighbors in time show the same.
const ASKED: usize = 5;

/// Share of the object further than [`REACH`] from any reading of it, in some of the views.
fn unread_share(frames: &[RgbdFrame], noise: &NoiseConfig, stop: &Stop) -> Result<f64, Stopped> {
    let asked: Vec<&RgbdFrame> = frames.iter().step_by(ASKED).collect();
    let counts: Vec<[usize; 2]> = asked
        .par_iter()
        .map(|frame| stop.check().map(|()| Cells::of_frame(frame, noise).unread_counts(REACH as usize)))
        .collect::<Result<_, Stopped>>()?;
    let sum = |k: usize| counts.iter().map(|count| count[k]).sum::<usize>();
    Ok(sum(1) as f64 / sum(0).max(1) as f64)
}

/// Counts of filled pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ColorDepth {
    /// Share of the object far from any reading of it.
    pub unread: f64,
    /// Pixels of the object without depth.
    pub holes: usize,
    /// ... with one now.
    pub filled: usize,
    /// Relative standard deviation of such a depth, by how views differ; 0 where none was filled.
    pub relative_sigma: f64,
}

/// Fills holes on the object by alike patches of the views of one state, and sets the `readings` of these
/// pixels by the difference of views there. Read depth stays as it is. Masks must be the recording's:
/// without, a pixel without depth may show anything. `None` where it is not due.
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

/// Writes a view's agreed depths to the pixels without one.
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
