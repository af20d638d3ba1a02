//! Which group of cells is the object.

use nalgebra::Point3;

use super::voxels::{Cell, center, clusters};
use crate::capture::CaptureError;

/// The object's cells.
pub struct Object {
    /// Sorted cells of both states.
    pub cells: Vec<Cell>,
    /// What was kept.
    pub note: String,
}

impl Object {
    /// Whether a cell is part of the object.
    pub fn contains(&self, cell: &Cell) -> bool {
        self.cells.binary_search(cell).is_ok()
    }
}

/// Groups the cells of both states and keeps the group that has the most cells near the point that the
/// cameras look at, with smaller groups inside its bounds. Within a workspace every group is kept that has
/// more than a few cells.
///
/// # Errors
/// [`CaptureError::Isolation`] where there are no cells.
pub fn choose_object(
    cells: &[Vec<Cell>],
    size_m: f64,
    reach: i32,
    focus: Option<Point3<f64>>,
    in_workspace: bool,
) -> Result<Object, CaptureError> {
    let mut all: Vec<Cell> = cells.iter().flatten().copied().collect();
    all.sort_unstable();
    all.dedup();
    let groups = clusters(&all, reach);
    let score = |g: &[Cell]| score(g, size_m, focus);
    let best = (0..groups.len()).fold(None, |best: Option<usize>, g| match best {
        Some(b) if score(&groups[b]) >= score(&groups[g]) => Some(b),
        _ => Some(g),
    });
    let Some(best) = best else {
        return Err(CaptureError::Isolation { reason: "nothing stands out from the background".into() });
    };
    let (lower, upper) = bounds(&groups[best]);
    // Inside its bounds are parts of the object that holes cut off; beside them stand other things.
    let inside = |g: &[Cell]| {
        let (l, u) = bounds(g);
        (0..3).all(|k| l[k] >= lower[k] - reach && u[k] <= upper[k] + reach)
    };
    let large = |g: &[Cell]| g.len() * 200 >= groups[best].len();
    let kept: Vec<usize> = (0..groups.len())
        .filter(|g| *g == best || (large(&groups[*g]) && (in_workspace || inside(&groups[*g]))))
        .collect();
    let mut object: Vec<Cell> = kept.iter().flat_map(|g| groups[*g].iter().copied()).collect();
    object.sort_unstable();
    let (l, u) = bounds(&object);
    let corner = |c: Cell, d: i32| c.map(|v| format!("{:.3}", f64::from(v + d) * size_m)).join(", ");
    let note = format!(
        "no masks: object isolated as {} of {} groups of points, {} of {} cells of {:.1} mm, in the box ({}) \
         to ({}) m",
        kept.len(),
        groups.len(),
        object.len(),
        all.len(),
        1e3 * size_m,
        corner(l, 0),
        corner(u, 1)
    );
    Ok(Object { cells: object, note })
}

/// Cells of a group, counted less the further they are from the focus, against the group nearest to it.
fn score(group: &[Cell], size_m: f64, focus: Option<Point3<f64>>) -> f64 {
    let Some(focus) = focus else { return group.len() as f64 };
    let nearest = group.iter().map(|c| (center(c, size_m) - focus).norm()).fold(f64::INFINITY, f64::min);
    let extent = {
        let (l, u) = bounds(group);
        (0..3).map(|k| f64::from(u[k] - l[k] + 1) * size_m).fold(0.0, f64::max)
    };
    // A group as far from the focus as it is large counts half.
    group.len() as f64 / (1.0 + (nearest / extent.max(size_m)).powi(2))
}

fn bounds(group: &[Cell]) -> (Cell, Cell) {
    group.iter().fold(([i32::MAX; 3], [i32::MIN; 3]), |(l, u), c| {
        (std::array::from_fn(|k| l[k].min(c[k])), std::array::from_fn(|k| u[k].max(c[k])))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(at: i32, side: i32) -> Vec<Cell> {
        (0..side).flat_map(|x| (0..side).flat_map(move |y| (0..side).map(move |z| [at + x, y, z]))).collect()
    }

    #[test]
    fn the_group_that_the_cameras_look_at_wins_over_a_larger_one() {
        let cells = [[block(0, 6), block(100, 9)].concat(), Vec::new()];
        let focus = Point3::new(0.03, 0.03, 0.03);
        let object = choose_object(&cells, 0.01, 2, Some(focus), false).unwrap();
        assert_eq!(object.cells, block(0, 6));
        assert_eq!(choose_object(&cells, 0.01, 2, None, false).unwrap().cells, block(100, 9));
        assert!(object.note.contains("1 of 2 groups"), "{}", object.note);
    }

    #[test]
    fn a_part_that_hangs_on_in_the_other_state_is_kept() {
        // In state 0 the far part is loose; state 1 has the bridge.
        let bridge: Vec<Cell> = (6..20).map(|x| [x, 0, 0]).collect();
        let cells = [[block(0, 6), block(20, 3)].concat(), [block(0, 6), bridge].concat()];
        let object = choose_object(&cells, 0.01, 1, Some(Point3::origin()), false).unwrap();
        assert!(object.contains(&[22, 2, 2]) && object.contains(&[10, 0, 0]));
    }

    #[test]
    fn no_cells_are_no_object() {
        assert!(choose_object(&[Vec::new(), Vec::new()], 0.01, 1, None, false).is_err());
    }
}
