//! Planes that belong to the object: a door that is shut in a wall, a drawer in a kitchen front.
//!
//! Things stand on a floor and before a wall without being of it. A plane is of the object where a part of
//! its own surface left it, as a door that opens, or where something stands before it that was nowhere in
//! another state, as a drawer whose front was in the plane.

use rayon::prelude::*;

use super::{
    Standing,
    background::{Background, in_box},
    change::{LEAST_PATCH, filtered, is_gone_elsewhere},
    select::{ALSO, CLEARLY, bounds},
    support::STRIDE,
    voxels::{Cell, cell_of_point, center_of_cell, frames_needed, groups, supported_cells},
};
use crate::RgbdFrame;
use common::stop::{Stop, Stopped};

/// Margin about what moved in which its plane belongs to the object, share of the longest side.
/// chosen: the frame on all sides is then about as large as what moves in it
pub(super) const FRAME: f64 = 0.25;
/// Reach of patches on a plane, cells. derived: every second pixel is looked at
const PATCH_REACH: i32 = 2;

/// A plane of the background by its index, and the box, lower and upper corner in the world, meters, in which
/// it belongs to the object.
pub type Claim = (usize, [[f64; 3]; 2]);

/// The planes that belong to the object. Nothing without a change.
pub(super) fn claimed_planes(
    standing: &Standing,
    background: &Background<'_>,
    states: &[Vec<RgbdFrame>],
    size_m: f64,
    stop: &Stop,
) -> Result<Vec<Claim>, Stopped> {
    let changed_of = |group: &[Cell]| group.iter().filter(|c| standing.changed.contains(*c)).count();
    let most = standing.groups.iter().map(|g| changed_of(g)).max().unwrap_or(0);
    if most == 0 || background.planes.is_empty() {
        return Ok(Vec::new());
    }
    let mut moved: Vec<Vec<Cell>> = vec![Vec::new(); background.planes.len()];
    for group in &standing.groups {
        if CLEARLY * changed_of(group) as f64 <= most as f64 || !is_missing_in_a_state(group, &standing.cells)
        {
            continue;
        }
        if let Some(plane) = touched_plane(group, background, size_m) {
            moved[plane].extend(group);
        }
    }
    let (lower, upper) = bounds(standing.changed.iter());
    let side = (0..3).map(|k| upper[k] - lower[k]).max().unwrap_or(0);
    let near = widened(lower, upper, side, size_m);
    for (plane, moved) in moved.iter_mut().enumerate() {
        for state in 0..states.len() {
            let on_plane = cells_on_plane(plane, background, &states[state], &near, size_m, stop)?;
            let is_gone = |c: &Cell| is_gone_elsewhere(c, state, states, size_m, &background.noise);
            let patches = groups(&filtered(&on_plane, is_gone, stop)?, PATCH_REACH, stop)?;
            let left: Vec<Cell> = patches.into_iter().filter(|p| p.len() >= LEAST_PATCH).flatten().collect();
            if CLEARLY * left.len() as f64 > most as f64 {
                moved.extend(left);
                moved.extend(&standing.changed);
            }
        }
    }
    let claims = moved.iter().enumerate().filter(|(_, moved)| !moved.is_empty());
    Ok(claims.map(|(plane, moved)| (plane, frame_of(moved, size_m))).collect())
}

/// Whether hardly any cell of a group is occupied in some state.
fn is_missing_in_a_state(group: &[Cell], cells: &[Vec<Cell>]) -> bool {
    let occupied = |of_state: &Vec<Cell>| group.iter().filter(|c| of_state.binary_search(c).is_ok()).count();
    let counts: Vec<usize> = cells.iter().map(occupied).collect();
    let most = counts.iter().max().copied().unwrap_or(0);
    counts.iter().any(|count| *count as f64 <= ALSO * most as f64)
}

/// The plane that comes nearest to a group, if the frame that it would have about it reaches the plane.
fn touched_plane(group: &[Cell], background: &Background<'_>, size_m: f64) -> Option<usize> {
    let mut nearest: Option<(f64, usize)> = None;
    for (index, plane) in background.planes.iter().enumerate() {
        let heights_m = group.iter().map(|c| plane.height_m(&center_of_cell(c, size_m)));
        let least_m = heights_m.fold(f64::INFINITY, f64::min);
        if nearest.is_none_or(|(height_m, _)| least_m < height_m) {
            nearest = Some((least_m, index));
        }
    }
    let (lower, upper) = bounds(group.iter());
    let side_m = size_m * (0..3).map(|k| f64::from(upper[k] - lower[k] + 1)).fold(0.0, f64::max);
    nearest.filter(|(height_m, _)| *height_m <= FRAME * side_m).map(|(_, index)| index)
}

/// Sorted cells in a box that enough frames of a state read on a plane.
fn cells_on_plane(
    plane: usize,
    background: &Background<'_>,
    frames: &[RgbdFrame],
    near: &[[f64; 3]; 2],
    size_m: f64,
    stop: &Stop,
) -> Result<Vec<Cell>, Stopped> {
    let of_frames: Vec<Vec<Cell>> = frames
        .par_iter()
        .map(|frame| stop.check().map(|()| frame_cells_on_plane(plane, background, frame, near, size_m)))
        .collect::<Result<_, Stopped>>()?;
    Ok(supported_cells(&of_frames, frames_needed(frames.len())))
}

fn frame_cells_on_plane(
    plane: usize,
    background: &Background<'_>,
    frame: &RgbdFrame,
    near: &[[f64; 3]; 2],
    size_m: f64,
) -> Vec<Cell> {
    let k = &frame.intrinsics;
    let plane = &background.planes[plane];
    let mut cells = Vec::new();
    for v in (0..k.height).step_by(STRIDE) {
        for u in (0..k.width).step_by(STRIDE) {
            let pixel = v * k.width + u;
            let Some(point) = frame.world_point(pixel).filter(|p| in_box(Some(*near), p)) else { continue };
            let ray = frame.world_from_camera.rotation * k.ray_at(u as f64, v as f64);
            let sigma_m = background.noise.sigma_m(f64::from(frame.depth_m[pixel]));
            if plane.is_on(&point, &ray, sigma_m) {
                cells.extend(cell_of_point(&point, size_m));
            }
        }
    }
    cells.sort_unstable();
    cells.dedup();
    cells
}

/// The box about cells with a margin, meters.
fn frame_of(cells: &[Cell], size_m: f64) -> [[f64; 3]; 2] {
    let (lower, upper) = bounds(cells.iter());
    widened(lower, upper, margin_of(lower, upper), size_m)
}

/// The same in cells, about the box between two of them.
pub(super) fn frame_of_cells(lower: Cell, upper: Cell) -> [Cell; 2] {
    let margin = margin_of(lower, upper);
    [lower.map(|v| v.saturating_sub(margin)), upper.map(|v| v.saturating_add(margin))]
}

/// The margin about the box between two cells, cells.
fn margin_of(lower: Cell, upper: Cell) -> i32 {
    let side = (0..3).map(|k| upper[k] - lower[k] + 1).max().unwrap_or(1);
    (FRAME * f64::from(side)).ceil() as i32
}

/// The box between two cells, widened by a number of cells to all sides, meters.
fn widened(lower: Cell, upper: Cell, by: i32, size_m: f64) -> [[f64; 3]; 2] {
    [
        lower.map(|v| f64::from(v.saturating_sub(by)) * size_m),
        upper.map(|v| f64::from(v.saturating_add(by + 1)) * size_m),
    ]
}
