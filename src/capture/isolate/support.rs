//! Surfaces that stand out from the background by more than its noise.
//!
//! Some of the many readings of a floor lie far above it by chance. So readings are judged in columns along
//! the plane's normal, over squares of the plane. A cell counts only if it has enough readings relative to
//! the background in its column. A column with hardly any reading below the plane shows no background: its
//! readings belong to the object down to the plane, even where single readings are too noisy to decide.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use rustc_hash::{FxHashMap, FxHashSet};

use super::{
    background::{Background, in_box},
    voxels::{Cell, cell_of_point, center_of_cell, frames_needed},
};
use crate::RgbdFrame;
use common::stop::{Stop, Stopped};

/// Least readings of a cell, relative to the background readings of its column. Chance gives 0.1 % beyond
/// three standard deviations, real sensors a little more. tuned: made and recorded objects
/// (docs/method.md 16)
const COLUMN_SHARE: f64 = 0.03;
/// Largest share of readings below the plane in a column without background (with background: one half).
/// tuned: made and recorded objects (docs/method.md 16)
const BELOW_SHARE: f64 = 0.05;
/// Fewest readings for a column to be judged.
const MIN_READINGS: u32 = 20;
/// Stride of the pixels counted in columns.
pub const STRIDE: usize = 2;

/// A square of a background plane: index of the plane and two coordinates.
pub type Column = (usize, i32, i32);

/// Surfaces that stand out from the background in one state.
pub struct Support {
    /// Sorted cells.
    pub cells: Vec<Cell>,
    /// Columns without background.
    pub solid: FxHashSet<Column>,
}

#[derive(Clone, Copy, Default)]
struct ColumnReadings {
    /// Readings too close to the plane to stand out.
    background: u32,
    /// Readings up to one cell above those.
    low: u32,
    /// Readings behind the plane.
    below: u32,
}

impl ColumnReadings {
    /// Whether the readings show no background.
    fn are_solid(&self) -> bool {
        self.low >= MIN_READINGS && f64::from(self.below) <= BELOW_SHARE * f64::from(self.low)
    }
}

#[derive(Default)]
struct Readings {
    cells: FxHashMap<Cell, u32>,
    columns: FxHashMap<Column, ColumnReadings>,
}

/// Surfaces that stand out in the frames of a state. `weights` per frame: 0 for pixels at depth edges, which
/// may float between object and background.
pub fn find_support(
    frames: &[RgbdFrame],
    weights: &[Vec<f32>],
    size_m: f64,
    background: &Background,
    stop: &Stop,
) -> Result<Support, Stopped> {
    let readings: Vec<Readings> = frames
        .par_iter()
        .zip(weights)
        .map(|(frame, weights)| stop.check().map(|()| readings_of_frame(frame, weights, size_m, background)))
        .collect::<Result<_, Stopped>>()?;
    // Number of frames and of readings in a cell.
    let mut totals: FxHashMap<Cell, (usize, u32)> = FxHashMap::default();
    let mut columns: FxHashMap<Column, ColumnReadings> = FxHashMap::default();
    for r in &readings {
        stop.check()?;
        for (c, n) in &r.cells {
            let total = totals.entry(*c).or_default();
            *total = (total.0 + 1, total.1 + n);
        }
        for (c, n) in &r.columns {
            let total = columns.entry(*c).or_default();
            total.background += n.background;
            total.low += n.low;
            total.below += n.below;
        }
    }
    let needed = frames_needed(frames.len());
    let mut cells: Vec<Cell> = Vec::new();
    for (cell, (seen_by, count)) in totals {
        let point = center_of_cell(&cell, size_m);
        let behind = background
            .planes_at(&point)
            .filter_map(|p| columns.get(&column_of_point(p, &point, size_m, background)))
            .map(|n| n.background)
            .max();
        // Columns count only every [`STRIDE`]th pixel and row, cells all.
        let behind = behind.map_or(0.0, |n| f64::from(n) * (STRIDE * STRIDE) as f64);
        if seen_by >= needed && f64::from(count) >= COLUMN_SHARE * behind {
            cells.push(cell);
        }
    }
    cells.sort_unstable();
    let solid = columns.into_iter().filter(|(_, n)| n.are_solid()).map(|(c, _)| c).collect();
    Ok(Support { cells, solid })
}

impl Support {
    /// Whether a point near a plane is in a column without background.
    pub fn is_solid(&self, point: &Point3<f64>, size_m: f64, background: &Background) -> bool {
        background.nearest_plane(point).is_some_and(|p| {
            background.planes[p].height_m(point) > 0.0
                && self.solid.contains(&column_of_point(p, point, size_m, background))
        })
    }
}

fn readings_of_frame(frame: &RgbdFrame, weights: &[f32], size_m: f64, background: &Background) -> Readings {
    let mut readings = Readings::default();
    let width = frame.intrinsics.width;
    for p in (0..weights.len()).filter(|p| weights[*p] > 0.0) {
        let Some(point) = frame.world_point(p) else { continue };
        let above = background.is_above(frame, p, &point);
        if let Some(c) = cell_of_point(&point, size_m)
            .filter(|_| above && in_box(background.config.isolate.workspace, &point))
        {
            *readings.cells.entry(c).or_default() += 1;
        }
        if !(p % width).is_multiple_of(STRIDE) || !(p / width).is_multiple_of(STRIDE) {
            continue;
        }
        let Some(plane) = background.nearest_plane(&point) else { continue };
        // At the foot of its column: one cell lower, it would not stand out.
        let lowered = point - background.planes[plane].normal.into_inner() * size_m;
        if !above || !background.is_above(frame, p, &lowered) {
            let entry =
                readings.columns.entry(column_of_point(plane, &point, size_m, background)).or_default();
            entry.background += u32::from(!above);
            entry.low += 1;
            entry.below += u32::from(background.planes[plane].height_m(&point) < 0.0);
        }
    }
    readings
}

fn column_of_point(plane: usize, point: &Point3<f64>, size_m: f64, background: &Background) -> Column {
    let normal = background.planes[plane].normal;
    // Any fixed choice of axes in the plane works.
    let helper = if normal.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let a = normal.cross(&helper).normalize();
    let b = normal.cross(&a);
    let place = |d: Vector3<f64>| (d.dot(&point.coords) / size_m).floor() as i32;
    (plane, place(a), place(b))
}
