//! Choice of the group of cells that is the object.

use nalgebra::Point3;

use super::voxels::{Cell, CellSet, center_of_cell, groups};
use crate::CaptureError;
use common::stop::{Stop, Stopped};

/// Least ratio of changed cells between two groups for one to be clearly the changed one.
/// tuned: eval/tracking/objects.py, seeds 9101 to 9110: things at rest have at most 0.1 of the object's
/// changes
pub const CLEARLY: f64 = 4.0;

/// A group within the object's bounds is a part of it if it has this share of the best group's changes.
/// chosen: fewer may be chance at the rim of a thing at rest
pub const ALSO: f64 = 0.05;
/// Fewest cells at a support for a group to stand on it.
/// derived: as for a patch of changed cells
const STANDING: usize = 8;
/// Parts of a thing are at most this fraction of the smaller part's length apart.
/// derived: two measured links with an unmeasured dark one between, a fifth as long
const PIECES_APART: i32 = 5;
/// Most cells of a group used for distances.
const PROBED: usize = 500;

/// Input of the search for the object.
pub struct Search<'a> {
    /// Side of a cell, meters.
    pub size_m: f64,
    /// Cells within this distance belong to one group, cells.
    pub reach: i32,
    /// Cells that changed between states.
    pub changed: &'a CellSet,
    /// Whether a cell touches a surface that may support the object.
    pub is_at_support: &'a (dyn Fn(&Cell) -> bool + Sync),
    /// Point at which the cameras look.
    pub focus: Option<Point3<f64>>,
    /// Given point on the object.
    pub at: Option<Point3<f64>>,
    /// Whether all groups are the object, as in a given box.
    pub takes_all: bool,
}

/// The cells of the object.
pub struct Object {
    /// Sorted cells of all states.
    pub cells: Vec<Cell>,
    /// Whether it was found by what changed between the states.
    pub is_by_change: bool,
    /// Describes how it was chosen.
    pub note: String,
}

impl Object {
    /// Whether a cell is part of the object.
    pub fn contains(&self, cell: &Cell) -> bool {
        self.cells.binary_search(cell).is_ok()
    }
}

/// The connected groups of the cells of all states together: parts separate in one state may be connected in
/// another.
pub fn groups_of_states(cells: &[Vec<Cell>], reach: i32, stop: &Stop) -> Result<Vec<Vec<Cell>>, Stopped> {
    let mut all: Vec<Cell> = cells.iter().flatten().copied().collect();
    all.sort_unstable();
    all.dedup();
    groups(&all, reach, stop)
}

/// Returns one of the groups, with the smaller groups inside its bounds: the group
/// at the given point; else the group that changed between states; else the group with the most cells near
/// the cameras' focus. If `takes_all`, every group of more than a few cells is kept.
///
/// # Errors
/// [`CaptureError::Isolation`] without cells, [`CaptureError::SeveralChanged`] if two things changed about as
/// much.
pub fn choose_object(search: &Search<'_>, groups: &[Vec<Cell>]) -> Result<Object, CaptureError> {
    let changed: Vec<usize> = groups.iter().map(|g| search.changed_of(g)).collect();
    let (best, why) = search.best(groups, &changed)?;
    let reach = search.reach;
    let core = search.core(groups, &changed, best);
    let (lower, upper) = bounds(core.iter().flat_map(|g| &groups[*g]));
    // Groups inside the bounds are parts cut off by holes in depth; groups outside are other things.
    let mut kept = Vec::new();
    for (g, group) in groups.iter().enumerate() {
        let (l, u) = bounds(group.iter());
        let is_inside = (0..3).all(|k| l[k] >= lower[k] - reach && u[k] <= upper[k] + reach);
        let is_large = group.len() * 200 >= groups[best].len();
        if core.contains(&g) || (is_large && (search.takes_all || is_inside)) {
            kept.push(g);
        }
    }
    let mut object: Vec<Cell> = kept.iter().flat_map(|g| groups[*g].iter().copied()).collect();
    object.sort_unstable();
    let (l, u) = bounds(object.iter());
    let corner = |c: Cell, d: i32| c.map(|v| format!("{:.3}", f64::from(v + d) * search.size_m)).join(", ");
    let note = format!(
        "no masks: object isolated as {} of {} groups of points, {why}; {} of {} cells of {:.1} mm, in the \
         box ({}) to ({}) m",
        kept.len(),
        groups.len(),
        object.len(),
        groups.iter().map(Vec::len).sum::<usize>(),
        1e3 * search.size_m,
        corner(l, 0),
        corner(u, 1)
    );
    let is_by_change = search.at.is_none() && !search.takes_all && changed[best] > 0;
    Ok(Object { cells: object, is_by_change, note })
}

impl Search<'_> {
    /// Number of changed cells of a group.
    fn changed_of(&self, group: &[Cell]) -> usize {
        group.iter().filter(|c| self.changed.contains(*c)).count()
    }

    /// Index of the object's group, and why it was chosen; `changed` counts the changed cells of each group.
    fn best(&self, groups: &[Vec<Cell>], changed: &[usize]) -> Result<(usize, String), CaptureError> {
        let nothing = || CaptureError::Isolation { reason: "nothing stands out from the background".into() };
        if let Some(at) = self.at {
            let nearness = groups.iter().map(|g| -distance_m(g, self.size_m, &at));
            let nearest = first_greatest(nearness).ok_or_else(nothing)?;
            return Ok((nearest, "the one at the given place".into()));
        }
        let mut order: Vec<(usize, usize)> = changed.iter().copied().zip(0..).collect();
        order.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        match (self.takes_all, &order[..]) {
            (false, &[(most, best), ref others @ ..]) if most > 0 => {
                let also: Vec<usize> = others
                    .iter()
                    .filter(|(count, g)| {
                        CLEARLY * *count as f64 > most as f64 && !self.is_one(&groups[best], &groups[*g])
                    })
                    .map(|(_, g)| *g)
                    .collect();
                if also.is_empty() {
                    let next = others.first().map_or(0, |o| o.0);
                    return Ok((best, format!("by what changed ({most} cells; the next {next})")));
                }
                let changed = [&best].into_iter().chain(&also);
                let at = changed.map(|g| middle(&groups[*g], self.size_m)).collect();
                Err(CaptureError::SeveralChanged { at })
            }
            _ => {
                let scores = groups.iter().map(|g| score(g, self.size_m, self.focus));
                let best = first_greatest(scores).ok_or_else(nothing)?;
                Ok((best, "the one that the cameras look at".into()))
            }
        }
    }

    /// The best group, the other changed groups within its bounds, and the groups that support them, as
    /// nothing floats. Dark parts are often not measured, so one thing may consist of several groups.
    fn core(&self, groups: &[Vec<Cell>], changed: &[usize], best: usize) -> Vec<usize> {
        let most = changed[best] as f64;
        let mut core = vec![best];
        if self.takes_all || most == 0.0 {
            return core;
        }
        let others = || (0..groups.len()).filter(|g| *g != best);
        let moved: Vec<usize> = others().filter(|g| changed[*g] as f64 > ALSO * most).collect();
        while let Some(next) = moved
            .iter()
            .find(|g| !core.contains(g) && core.iter().any(|k| self.is_one(&groups[*k], &groups[**g])))
        {
            core.push(*next);
        }
        let stands = |g: usize| groups[g].iter().filter(|c| (self.is_at_support)(c)).count() >= STANDING;
        if !core.iter().any(|g| stands(*g)) {
            let mut below: Vec<(f64, usize)> = Vec::new();
            for g in others().filter(|g| stands(*g)) {
                let distances = core.iter().map(|k| apart(&groups[*k], &groups[g]));
                below.push((distances.fold(f64::INFINITY, f64::min), g));
            }
            core.extend(below.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, g)| g));
        }
        core
    }

    /// Whether the bounds of two groups touch or nearly touch, as those of parts of one thing.
    fn is_one(&self, a: &[Cell], b: &[Cell]) -> bool {
        let (la, ua) = bounds(a.iter());
        let (lb, ub) = bounds(b.iter());
        let extent = |l: Cell, u: Cell| (0..3).map(|k| u[k] - l[k]).max().unwrap_or(0);
        let margin = (2 * self.reach).max(extent(la, ua).min(extent(lb, ub)) / PIECES_APART);
        (0..3).all(|k| la[k] - margin <= ub[k] && lb[k] - margin <= ua[k])
    }
}

/// Index of the greatest value, the first of equals.
fn first_greatest(values: impl Iterator<Item = f64>) -> Option<usize> {
    let mut best: Option<(usize, f64)> = None;
    for (i, value) in values.enumerate() {
        if !best.is_some_and(|(_, greatest)| greatest >= value) {
            best = Some((i, value));
        }
    }
    best.map(|(i, _)| i)
}

/// Distance from a point to the nearest cell of a group, meters.
fn distance_m(group: &[Cell], size_m: f64, from: &Point3<f64>) -> f64 {
    group.iter().map(|c| (center_of_cell(c, size_m) - from).norm()).fold(f64::INFINITY, f64::min)
}

/// Center of a group's bounds, meters.
fn middle(group: &[Cell], size_m: f64) -> [f64; 3] {
    let (lower, upper) = bounds(group.iter());
    [0, 1, 2].map(|k| 0.5 * size_m * f64::from(lower[k] + upper[k] + 1))
}

/// Number of cells, reduced with the distance of the group from the focus. See docs/method.md (2.19).
fn score(group: &[Cell], size_m: f64, focus: Option<Point3<f64>>) -> f64 {
    let Some(focus) = focus else { return group.len() as f64 };
    let nearest = distance_m(group, size_m, &focus);
    let extent = {
        let (l, u) = bounds(group.iter());
        (0..3).map(|k| f64::from(u[k] - l[k] + 1) * size_m).fold(0.0, f64::max)
    };
    // A group as far from the focus as its extent counts half.
    group.len() as f64 / (1.0 + (nearest / extent.max(size_m)).powi(2))
}

/// Distance between two groups, cells; large groups are subsampled.
fn apart(a: &[Cell], b: &[Cell]) -> f64 {
    let mut least = f64::INFINITY;
    for p in a.iter().step_by(a.len().div_ceil(PROBED)) {
        for q in b.iter().step_by(b.len().div_ceil(PROBED)) {
            let square = (0..3).map(|k| f64::from(p[k] - q[k]).powi(2)).sum::<f64>();
            least = least.min(square);
        }
    }
    least.sqrt()
}

/// Least and greatest coordinates of cells.
pub fn bounds<'a>(cells: impl Iterator<Item = &'a Cell>) -> (Cell, Cell) {
    cells.fold(([i32::MAX; 3], [i32::MIN; 3]), |(l, u), c| {
        (std::array::from_fn(|k| l[k].min(c[k])), std::array::from_fn(|k| u[k].max(c[k])))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(at: i32, side: i32) -> Vec<Cell> {
        (0..side).flat_map(|x| (0..side).flat_map(move |y| (0..side).map(move |z| [at + x, y, z]))).collect()
    }

    fn search(reach: i32, changed: &CellSet) -> Search<'_> {
        let focus = Some(Point3::new(0.03, 0.03, 0.03));
        let at = None;
        let is_at_support = &|c: &Cell| c[2] == 0;
        Search { size_m: 0.01, reach, changed, is_at_support, focus, at, takes_all: false }
    }

    fn chosen(cells: &[Vec<Cell>], search: &Search<'_>) -> Result<Object, CaptureError> {
        choose_object(search, &groups_of_states(cells, search.reach, &Stop::never()).unwrap())
    }

    #[test]
    fn the_group_that_the_cameras_look_at_wins_over_a_larger_one() {
        let cells = [[block(0, 6), block(100, 9)].concat(), Vec::new()];
        let still = CellSet::default();
        let nowhere = None;
        let object = chosen(&cells, &search(2, &still)).unwrap();
        assert_eq!(object.cells, block(0, 6));
        let blind = Search { focus: nowhere, ..search(2, &still) };
        assert_eq!(chosen(&cells, &blind).unwrap().cells, block(100, 9));
        assert!(object.note.contains("1 of 2 groups"), "{}", object.note);
        let at = Search { at: Some(Point3::new(1.2, 1.0, 1.0)), ..search(2, &still) };
        assert_eq!(chosen(&cells, &at).unwrap().cells, block(100, 9));
    }

    #[test]
    fn what_changed_wins_over_what_the_cameras_look_at_and_two_such_things_are_asked_about() {
        let cells = [[block(0, 6), block(100, 9)].concat(), Vec::new()];
        let mut changed: CellSet = block(100, 3).into_iter().collect();
        assert_eq!(chosen(&cells, &search(2, &changed)).unwrap().cells, block(100, 9));
        changed.extend(block(0, 1));
        assert_eq!(chosen(&cells, &search(2, &changed)).unwrap().cells, block(100, 9));
        changed.extend(block(0, 3));
        let Err(CaptureError::SeveralChanged { at }) = chosen(&cells, &search(2, &changed)) else {
            panic!("two things changed alike")
        };
        assert!((at[0][0] - 0.03).abs() < 1e-9 && (at[1][0] - 1.045).abs() < 1e-9, "{at:?}");
        let all = Search { takes_all: true, ..search(2, &changed) };
        assert_eq!(chosen(&cells, &all).unwrap().cells.len(), 6 * 6 * 6 + 9 * 9 * 9);
    }

    #[test]
    fn a_thing_in_pieces_is_put_together_down_to_what_it_stands_on() {
        // A base, an arm above it that was not read at its foot, a head beyond; and a box nearby.
        let high = |cells: Vec<Cell>, z: i32| cells.into_iter().map(|[x, y, k]| [x, y, k + z]).collect();
        let (arm, head): (Vec<Cell>, Vec<Cell>) = (high(block(4, 6), 8), high(block(6, 9), 14));
        let still = [block(0, 8), block(60, 8).into_iter().map(|[x, y, z]| [x, y - 60, z - 60]).collect()];
        let cells = [[&still[0], &still[1], &arm, &head].map(|c| c.clone()).concat(), Vec::new()];
        let changed: CellSet = arm.iter().chain(&head).copied().collect();
        let object = chosen(&cells, &search(2, &changed)).unwrap();
        let all = [&still[0], &arm, &head].map(|c| c.clone()).concat().len();
        assert_eq!(object.cells.len(), all, "{}", object.note);
    }

    #[test]
    fn a_part_that_hangs_on_in_the_other_state_is_kept() {
        // In state 0 the far part is loose; state 1 has the bridge.
        let bridge: Vec<Cell> = (6..20).map(|x| [x, 0, 0]).collect();
        let cells = [[block(0, 6), block(20, 3)].concat(), [block(0, 6), bridge].concat()];
        let object = chosen(&cells, &search(1, &CellSet::default())).unwrap();
        assert!(object.contains(&[22, 2, 2]) && object.contains(&[10, 0, 0]));
    }

    #[test]
    fn no_cells_are_no_object() {
        assert!(chosen(&[Vec::new(), Vec::new()], &search(1, &CellSet::default())).is_err());
    }
}
