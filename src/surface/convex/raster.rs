//! A raster over a flat patch, with its seen cells and its gaps.

use nalgebra::{Point2, Vector2};

use super::rectangles::{Rectangle, covering_rectangles};
use crate::outline::{polygon_area, rectangle_direction};
use geometry::bounding_box;

/// Cells along the longer side of a patch. chosen: time against detail
const CELLS: f64 = 96.0;
/// Narrowest rectangle over a patch, cells, and share of the cells that may stay bare.
/// tuned: made and recorded objects (docs/method.md 16)
const MIN_SIDE: usize = 3;
const BARE: f64 = 0.06;
/// Least hidden share of a gap that is closed: a wall close by makes cells at its side look seen. tuned: made
/// and recorded objects (docs/method.md 16)
const HIDDEN: f64 = 2.0 / 3.0;
/// Gaps of a smaller share of the patch are artifacts of the raster. tuned: made and recorded objects
/// (docs/method.md 16)
const MIN_CLOSED: f64 = 0.02;

/// Cells along the smallest rectangle around a patch, in its plane.
pub(super) struct Raster {
    /// Direction of the rows.
    direction: Vector2<f64>,
    /// Lowest corner in rotated coordinates, and the extent.
    lower: Point2<f64>,
    side: Vector2<f64>,
    cell_m: f64,
    columns: usize,
    rows: usize,
    filled: Vec<bool>,
    /// Cells of closed gaps.
    closed: Vec<bool>,
}

impl Raster {
    /// A raster of the cells under triangles. It lies along `hull` and contains it and the `beside` points;
    /// cells are at least `min_cell_m` wide.
    pub(super) fn new(
        triangles: &[[Point2<f64>; 3]],
        hull: &[Point2<f64>],
        beside: &[Point2<f64>],
        min_cell_m: f64,
    ) -> Self {
        let direction = rectangle_direction(hull);
        let all = hull.iter().chain(beside).map(|p| turned_point(&direction, p));
        let (lower, upper) = bounding_box(all).unwrap_or_default();
        let side = upper - lower;
        let cell_m = (side.max() / CELLS).max(min_cell_m);
        let [columns, rows] = [side.x, side.y].map(|length| ((length / cell_m).ceil() as usize).max(1));
        let mut raster = Self {
            direction,
            lower,
            side,
            cell_m,
            columns,
            rows,
            filled: vec![false; columns * rows],
            closed: Vec::new(),
        };
        for triangle in triangles {
            raster.mark_triangle(
                &triangle.map(|p| Point2::from((turned_point(&direction, &p) - lower) / cell_m)),
            );
        }
        raster
    }

    /// Marks the cells whose center lies in a triangle (corners in cells).
    fn mark_triangle(&mut self, triangle: &[Point2<f64>; 3]) {
        let turn = polygon_area(triangle);
        let [a, b, c] = if turn >= 0.0 { *triangle } else { [triangle[0], triangle[2], triangle[1]] };
        let lo = a.inf(&b).inf(&c);
        let hi = a.sup(&b).sup(&c);
        for y in cells_between(lo.y, hi.y, self.rows) {
            for x in cells_between(lo.x, hi.x, self.columns) {
                let p = Point2::new(x as f64 + 0.5, y as f64 + 0.5);
                let inside = |a: &Point2<f64>, b: &Point2<f64>| (b - a).perp(&(p - a)) >= -1e-9;
                if inside(&a, &b) && inside(&b, &c) && inside(&c, &a) {
                    self.filled[y * self.columns + x] = true;
                }
            }
        }
    }

    /// Closes gaps within rows and columns: runs of cells from the patch to the patch or to one of `stops`.
    /// Most cells of a run must be `hidden`, and it may be no longer than the seen part of the patch in the
    /// row or column. Returns whether enough was closed.
    pub(super) fn close_gaps(
        &mut self,
        stops: &[Point2<f64>],
        hidden: impl Fn(&Point2<f64>) -> bool,
    ) -> bool {
        let mut stop = self.filled.clone();
        for p in stops {
            let at = (turned_point(&self.direction, p) - self.lower) / self.cell_m;
            let x = (at.x.max(0.0) as usize).min(self.columns - 1);
            let y = (at.y.max(0.0) as usize).min(self.rows - 1);
            stop[y * self.columns + x] = true;
        }
        let rows = (0..self.rows).map(|y| (0..self.columns).map(|x| y * self.columns + x).collect());
        let columns = (0..self.columns).map(|x| (0..self.rows).map(|y| y * self.columns + x).collect());
        let lines: Vec<Vec<usize>> = rows.chain(columns).collect();
        // Kept apart from the seen cells: a closed gap must not justify the next.
        let mut closed = vec![false; stop.len()];
        for line in &lines {
            let seen = line.iter().filter(|i| self.filled[**i]).count();
            let mut last: Option<usize> = None;
            for (k, &i) in line.iter().enumerate().filter(|(_, i)| stop[**i]) {
                if let Some(from) = last {
                    let gap = &line[from + 1..k];
                    let of_patch = self.filled[line[from]] || self.filled[i];
                    if of_patch && !gap.is_empty() && gap.len() <= seen {
                        let count = gap.iter().filter(|g| hidden(&self.middle_of_cell(**g))).count();
                        if count as f64 >= HIDDEN * gap.len() as f64 {
                            gap.iter().for_each(|g| closed[*g] = true);
                        }
                    }
                }
                last = Some(k);
            }
        }
        let [closed_count, filled_count] =
            [&closed, &self.filled].map(|cells| cells.iter().filter(|c| **c).count() as f64);
        let any = closed_count > MIN_CLOSED * filled_count;
        closed.iter_mut().zip(&self.filled).for_each(|(c, f)| *c &= !f);
        self.closed = closed;
        any
    }

    /// At most `most` rectangles over the cells of closed gaps.
    pub(super) fn closed_rectangles(&self, most: usize) -> Vec<[Point2<f64>; 4]> {
        let rectangles = covering_rectangles(&self.closed, self.columns, MIN_SIDE, BARE, most);
        rectangles.iter().map(|r| self.corners_of(r)).collect()
    }

    /// Corners of a rectangle, in the patch's plane.
    fn corners_of(&self, r: &Rectangle) -> [Point2<f64>; 4] {
        let x = r.x as f64;
        let y = r.y as f64;
        let width = r.width as f64;
        let height = r.height as f64;
        [(x, y), (x + width, y), (x + width, y + height), (x, y + height)].map(|(x, y)| self.place_of(x, y))
    }

    fn middle_of_cell(&self, cell: usize) -> Point2<f64> {
        self.place_of((cell % self.columns) as f64 + 0.5, (cell / self.columns) as f64 + 0.5)
    }

    /// A place given in cells, as a point in the patch's plane.
    fn place_of(&self, x: f64, y: f64) -> Point2<f64> {
        // The last cells may reach beyond the patch.
        let p = self.lower + Vector2::new(x * self.cell_m, y * self.cell_m).inf(&self.side);
        Point2::from(self.direction * p.x + Vector2::new(-self.direction.y, self.direction.x) * p.y)
    }
}

/// Cells of a row of `n` between two places, in cells.
fn cells_between(lo: f64, hi: f64, n: usize) -> std::ops::Range<usize> {
    (lo.floor().max(0.0) as usize)..((hi.ceil().max(0.0) as usize).min(n))
}

fn turned_point(direction: &Vector2<f64>, p: &Point2<f64>) -> Point2<f64> {
    Point2::new(p.coords.dot(direction), direction.perp(&p.coords))
}
