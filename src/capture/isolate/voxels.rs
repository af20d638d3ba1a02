//! Occupied cells of space, the number of frames that see them, and their groups.

use nalgebra::Point3;
use rayon::prelude::*;
use rustc_hash::{FxHashMap, FxHashSet};

use common::stop::{Stop, Stopped};

/// Cell coordinates.
pub type Cell = [i32; 3];
/// Unordered set of cells.
pub type CellSet = FxHashSet<Cell>;

/// Cell of a point; `None` if it is far outside any scene.
#[must_use]
pub fn cell_of_point(point: &Point3<f64>, size_m: f64) -> Option<Cell> {
    let c = [point.x, point.y, point.z].map(|v| v / size_m);
    // Leaves room for adding a reach without overflow.
    c.iter().all(|v| v.abs() < 1e6).then(|| c.map(floor_to_integer))
}

/// The whole number below; `floor` is a library call on processors without SSE 4.1.
fn floor_to_integer(v: f64) -> i32 {
    let whole = v as i32;
    whole - i32::from(f64::from(whole) > v)
}

/// Center of a cell, meters.
#[must_use]
pub fn center_of_cell(cell: &Cell, size_m: f64) -> Point3<f64> {
    Point3::from(cell.map(|v| (f64::from(v) + 0.5) * size_m))
}

/// Sorted cells seen by at least `frames_needed` frames, from the distinct cells of each frame.
#[must_use]
pub fn supported_cells(frames: &[Vec<Cell>], frames_needed: usize) -> Vec<Cell> {
    let mut all: Vec<Cell> = frames.iter().flatten().copied().collect();
    all.par_sort_unstable();
    let seen_by = all.chunk_by(|a, b| a == b);
    seen_by.filter(|same| same.len() >= frames_needed).map(|same| same[0]).collect()
}

/// Connected groups of sorted cells: neighbors are within `reach` (maximum norm, in cells). Each group is
/// sorted; groups are in order of their first cell.
#[must_use]
pub fn clusters_of_cells(cells: &[Cell], reach: i32) -> Vec<Vec<Cell>> {
    groups(cells, reach, &Stop::never()).unwrap_or_default()
}

/// [`clusters_of_cells`] with a stop flag.
pub(super) fn groups(cells: &[Cell], reach: i32, stop: &Stop) -> Result<Vec<Vec<Cell>>, Stopped> {
    let index: FxHashMap<Cell, usize> = cells.iter().enumerate().map(|(i, c)| (*c, i)).collect();
    let mut group = vec![usize::MAX; cells.len()];
    let mut groups: Vec<Vec<Cell>> = Vec::new();
    for start in 0..cells.len() {
        if group[start] != usize::MAX {
            continue;
        }
        let number = groups.len();
        let mut members = vec![start];
        group[start] = number;
        let mut next = 0;
        while next < members.len() {
            stop.check()?;
            for neighbor in cells_around(&cells[members[next]], reach) {
                if let Some(i) = index.get(&neighbor).filter(|i| group[**i] == usize::MAX) {
                    group[*i] = number;
                    members.push(*i);
                }
            }
            next += 1;
        }
        members.sort_unstable();
        groups.push(members.into_iter().map(|i| cells[i]).collect());
    }
    Ok(groups)
}

/// The cells and all cells within `reach` of them.
#[must_use]
pub fn dilated_cells(cells: &[Cell], reach: i32) -> CellSet {
    cells.iter().flat_map(|c| cells_around(c, reach)).collect()
}

/// All cells within `reach` of a cell, itself included.
fn cells_around(c: &Cell, reach: i32) -> impl Iterator<Item = Cell> + use<> {
    let c = *c;
    let range = move || -reach..=reach;
    range().flat_map(move |x| range().flat_map(move |y| range().map(move |z| [c[0] + x, c[1] + y, c[2] + z])))
}

/// Number of frames that must agree on a cell.
pub fn frames_needed(frames: usize) -> usize {
    if frames >= 6 { 2 } else { 1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_within_reach_hangs_together() {
        let cells = [[0, 0, 0], [0, 0, 2], [0, 1, 5], [9, 9, 9]];
        assert_eq!(clusters_of_cells(&cells, 1).len(), 4);
        assert_eq!(clusters_of_cells(&cells, 2).len(), 3);
        let three = clusters_of_cells(&cells, 3);
        assert_eq!(three, [vec![[0, 0, 0], [0, 0, 2], [0, 1, 5]], vec![[9, 9, 9]]]);
    }

    #[test]
    fn support_counts_frames() {
        let frames = [vec![[1, 0, 0], [0, 0, 0]], vec![[1, 0, 0]], vec![[-1, 0, 0], [1, 0, 0]]];
        assert_eq!(supported_cells(&frames, 2), [[1, 0, 0]]);
        assert_eq!(supported_cells(&frames, 1), [[-1, 0, 0], [0, 0, 0], [1, 0, 0]]);
    }

    #[test]
    fn cells_and_centers() {
        assert_eq!(cell_of_point(&Point3::new(-0.001, 0.0, 0.019), 0.01), Some([-1, 0, 1]));
        assert_eq!(cell_of_point(&Point3::new(f64::NAN, 0.0, 0.0), 0.01), None);
        assert_eq!(cell_of_point(&center_of_cell(&[3, -4, 0], 0.01), 0.01), Some([3, -4, 0]));
        assert_eq!(dilated_cells(&[[0, 0, 0]], 1).len(), 27);
    }
}
