//! The region of the views of a state, in coarse cells: seen empty, seen filled, or not seen.

use nalgebra::{Point3, Vector3};

use super::{
    eyes::{Eyes, Focus},
    sight_map::SightMap,
};

/// Largest number of cells along each side.
const MOST_CELLS: usize = 64;
/// Cells along a side of a patch.
pub(super) const PATCH: usize = 4;

/// State of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cell {
    /// It is not part of the region.
    Outside,
    /// No view saw it.
    Unknown,
    /// It was seen empty.
    Empty,
    /// Something was seen about it.
    Filled,
}

/// The ball of the views, limited to what at least half of them have in their image.
pub(super) struct Region {
    /// The focus of the views.
    pub focus: Focus,
    /// Radius of the ball, meters.
    pub radius_m: f64,
    /// Side of a cell, meters.
    pub cell_m: f64,
    /// Lower corner.
    pub origin: Point3<f64>,
    /// Cells along each side.
    pub side: usize,
    cells: Vec<Cell>,
}

impl Region {
    /// The region of the views so far; `None` without any.
    pub(super) fn new(eyes: &Eyes, sight: &SightMap) -> Option<Self> {
        let (focus, radius_m) = eyes.focus_ball()?;
        let fine_m = sight.cell_m();
        let per = (2.0 * radius_m / fine_m / MOST_CELLS as f64).ceil().max(1.0);
        let cell_m = per * fine_m;
        let per = per as i32;
        let side = ((2.0 * radius_m / cell_m).ceil() as usize + 1).min(MOST_CELLS + 1);
        let low = (focus.point.coords.add_scalar(-radius_m) / fine_m).map(f64::floor);
        if !low.iter().all(|v| v.abs() < 1e6) {
            return None;
        }
        let low = [low.x as i32, low.y as i32, low.z as i32];
        let high = low.map(|l| l + side as i32 * per - 1);
        let count = side * side * side;
        let mut empty = vec![0u16; count];
        let mut filled = vec![false; count];
        sight.for_each_cell([low, high], |cell, seen| {
            let at = [0, 1, 2].map(|k| (cell[k] - low[k]).div_euclid(per));
            if at.iter().all(|a| (0..side as i32).contains(a)) {
                let i = index(at.map(|a| a as usize), side);
                empty[i] = empty[i].saturating_add(u16::from(seen.empty > 0));
                filled[i] |= seen.filled > 0 && seen.empty < 2;
            }
        });
        let enough = per.pow(3).div_euclid(2).max(1) as u16;
        let mut cells = Vec::with_capacity(count);
        for (empty, is_filled) in empty.into_iter().zip(filled) {
            cells.push(match is_filled {
                true => Cell::Filled,
                false if empty >= enough => Cell::Empty,
                false => Cell::Unknown,
            });
        }
        let origin = Point3::from(low.map(|l| f64::from(l) * fine_m));
        let mut region = Self { focus, radius_m, cell_m, origin, side, cells };
        region.cut_to_images(eyes);
        Some(region)
    }

    /// Marks cells outside the images of half of the views.
    fn cut_to_images(&mut self, eyes: &Eyes) {
        let patches = self.side.div_ceil(PATCH);
        let mut shown = Vec::with_capacity(patches * patches * patches);
        for i in 0..patches * patches * patches {
            let patch = [i % patches, i / patches % patches, i / patches / patches];
            let middle = Vector3::from(patch.map(|c| (c as f64 + 0.5) * PATCH as f64));
            shown.push(eyes.half_show(&(self.origin + middle * self.cell_m)));
        }
        for i in 0..self.cells.len() {
            let at = [i % self.side, i / self.side % self.side, i / self.side / self.side];
            let is_near = (self.middle_of_cell(at) - self.focus.point).norm() <= self.radius_m;
            if !is_near || !shown[index(at.map(|a| a / PATCH), patches)] {
                self.cells[i] = Cell::Outside;
            }
        }
    }

    /// Center of a cell.
    pub(super) fn middle_of_cell(&self, at: [usize; 3]) -> Point3<f64> {
        self.origin + Vector3::from(at.map(|a| a as f64 + 0.5)) * self.cell_m
    }

    /// State of a cell.
    pub(super) fn cell_state(&self, at: [usize; 3]) -> Cell {
        self.cells[index(at, self.side)]
    }

    /// Whether a point is in the ball.
    pub(super) fn holds(&self, point: &Point3<f64>) -> bool {
        (point - self.focus.point).norm() <= self.radius_m
    }

    /// The first unknown or filled cell of the region along a ray, and its distance in lengths of the ray's
    /// direction; `None` where there is none. Cells are traversed one by one (Amanatides and Woo 1987).
    pub(super) fn first_met(&self, eye: &Point3<f64>, ray: &Vector3<f64>) -> Option<(Cell, f64)> {
        let size_m = self.side as f64 * self.cell_m;
        let mut enter = 0.0f64;
        let mut leave = f64::INFINITY;
        for k in 0..3 {
            let from = (self.origin[k] - eye[k]) / ray[k];
            let to = (self.origin[k] + size_m - eye[k]) / ray[k];
            // A ray parallel to a side gives infinities of the right signs, or NaN where it lies in the side.
            enter = enter.max(from.min(to));
            leave = leave.min(from.max(to));
        }
        if !(enter < leave) {
            return None;
        }
        let begin = (eye + ray * (enter + 1e-9) - self.origin) / self.cell_m;
        let last = self.side as i64 - 1;
        let mut at = [0, 1, 2].map(|k| (begin[k].floor() as i64).clamp(0, last));
        let mut next = [0, 1, 2].map(|k| {
            let border = self.origin[k] + (at[k] + i64::from(ray[k] > 0.0)) as f64 * self.cell_m;
            if ray[k] == 0.0 { f64::INFINITY } else { (border - eye[k]) / ray[k] }
        });
        let mut along = enter;
        loop {
            let met = self.cell_state(at.map(|a| a as usize));
            if matches!(met, Cell::Unknown | Cell::Filled) {
                return Some((met, along));
            }
            let axis = (0..3).fold(0, |least, k| if next[k] < next[least] { k } else { least });
            along = next[axis];
            at[axis] += if ray[axis] > 0.0 { 1 } else { -1 };
            if !(0..=last).contains(&at[axis]) {
                return None;
            }
            next[axis] += self.cell_m / ray[axis].abs();
        }
    }
}

fn index([x, y, z]: [usize; 3], side: usize) -> usize {
    x + side * (y + side * z)
}
