//! Cells of the scene cube near surfaces; rays are sampled only there (docs/method.md 12.2).

use nalgebra::{Point3, Vector3};

use geometry::SceneBox;

/// Most cells along a side.
const MAX_CELLS: usize = 512;

/// One bit per cell of a regular grid over the scene cube.
#[derive(Clone, Debug)]
pub struct Occupancy {
    scene: SceneBox,
    cells: usize,
    bits: Vec<u64>,
}

impl Occupancy {
    /// Marks the cells, of about `cell_m` meters, with one of the world points, and all cells within `reach`.
    /// Pass the points of all states: every field is defined wherever the object ever was. Cells are larger
    /// than requested if the cube would have more than 512 along a side.
    pub fn new<'a>(
        scene: &SceneBox,
        points: impl IntoIterator<Item = &'a Point3<f64>>,
        cell_m: f64,
        reach: usize,
    ) -> Self {
        let cells = (scene.side_m() / cell_m).ceil().clamp(1.0, MAX_CELLS as f64) as usize;
        let mut seeds = Self { scene: *scene, cells, bits: vec![0; cells.pow(3).div_ceil(64)] };
        for p in points {
            if let Some(c) = seeds.cell_of_point(p) {
                seeds.occupy_cell(c);
            }
        }
        // Dilation by a cube is separable by axis.
        for axis in 0..3 {
            seeds = seeds.dilated_along(axis, reach);
        }
        seeds
    }

    /// Dilates every cell along one axis.
    fn dilated_along(&self, axis: usize, reach: usize) -> Self {
        let mut out = self.clone();
        for (word, &bits) in self.bits.iter().enumerate() {
            let mut rest = bits;
            while rest != 0 {
                let i = 64 * word + rest.trailing_zeros() as usize;
                rest &= rest - 1;
                let c = [i % self.cells, i / self.cells % self.cells, i / (self.cells * self.cells)];
                for k in c[axis].saturating_sub(reach)..=(c[axis] + reach).min(self.cells - 1) {
                    let mut near = c;
                    near[axis] = k;
                    out.occupy_cell(near);
                }
            }
        }
        out
    }

    /// Cell of a world point; `None` outside the cube.
    fn cell_of_point(&self, point: &Point3<f64>) -> Option<[usize; 3]> {
        let n = self.in_cells(point);
        let inside = n.iter().all(|&x| x >= 0.0 && x < self.cells as f64);
        inside.then(|| [n.x as usize, n.y as usize, n.z as usize])
    }

    /// Converts world coordinates to cells.
    fn in_cells(&self, point: &Point3<f64>) -> Point3<f64> {
        Point3::from((self.scene.normalise(point).coords.add_scalar(1.0)) * (0.5 * self.cells as f64))
    }

    fn cell_index(&self, [x, y, z]: [usize; 3]) -> usize {
        x + self.cells * (y + self.cells * z)
    }

    fn occupy_cell(&mut self, cell: [usize; 3]) {
        let i = self.cell_index(cell);
        self.bits[i / 64] |= 1 << (i % 64);
    }

    fn is_occupied(&self, cell: [usize; 3]) -> bool {
        let i = self.cell_index(cell);
        self.bits[i / 64] >> (i % 64) & 1 == 1
    }

    /// Whether a world point lies in an occupied cell.
    pub fn contains(&self, point: &Point3<f64>) -> bool {
        self.cell_of_point(point).is_some_and(|c| self.is_occupied(c))
    }

    /// Writes to `out` the intervals of `t` in `[from, to]` with `origin + t direction` (world) in occupied
    /// cells: ascending, with adjacent ones joined.
    pub fn occupied_intervals(
        &self,
        origin: &Point3<f64>,
        direction: &Vector3<f64>,
        from: f64,
        to: f64,
        out: &mut Vec<(f64, f64)>,
    ) {
        out.clear();
        let o = self.in_cells(origin);
        let d = direction * (0.5 * self.scene.scale * self.cells as f64);
        let side = self.cells as f64;
        // Range of the ray inside the cube.
        let mut enter = from;
        let mut leave = to;
        for k in 0..3 {
            if d[k] == 0.0 {
                if !(o[k] >= 0.0 && o[k] < side) {
                    return;
                }
                continue;
            }
            let a = (0.0 - o[k]) / d[k];
            let b = (side - o[k]) / d[k];
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        // `partial_cmp` also ends rays with NaN.
        if enter.partial_cmp(&leave) != Some(std::cmp::Ordering::Less) {
            return;
        }
        // Cell by cell along the nearest boundary (Amanatides and Woo 1987).
        let mut cell = [0usize; 3];
        let mut next = [f64::INFINITY; 3];
        let mut step = [f64::INFINITY; 3];
        for k in 0..3 {
            let at = (o[k] + d[k] * enter).floor().clamp(0.0, side - 1.0);
            cell[k] = at as usize;
            if d[k] != 0.0 {
                let border = if d[k] > 0.0 { at + 1.0 } else { at };
                next[k] = (border - o[k]) / d[k];
                step[k] = 1.0 / d[k].abs();
            }
        }
        let mut t = enter;
        while t < leave {
            let axis =
                if next[0] <= next[1] && next[0] <= next[2] { 0 } else { usize::from(next[1] > next[2]) + 1 };
            let end = next[axis].min(leave);
            if self.is_occupied(cell) && end > t {
                match out.last_mut() {
                    // Exact equality: this interval begins where the last one ended.
                    Some(last) if last.1 == t => last.1 = end,
                    _ => out.push((t, end)),
                }
            }
            t = end.max(t);
            next[axis] += step[axis];
            if d[axis] > 0.0 {
                cell[axis] += 1;
                if cell[axis] >= self.cells {
                    return;
                }
            } else if cell[axis] == 0 {
                return;
            } else {
                cell[axis] -= 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit_cube() -> SceneBox {
        SceneBox { center: Point3::origin(), scale: 1.0 }
    }

    #[test]
    fn cells_near_points_are_occupied() {
        let o = Occupancy::new(&unit_cube(), &[Point3::new(0.05, 0.05, 0.05)], 0.1, 2);
        assert!(o.contains(&Point3::new(0.25, -0.15, 0.05)) && !o.contains(&Point3::new(0.35, 0.05, 0.05)));
        assert_eq!(o.bits.iter().map(|b| b.count_ones()).sum::<u32>(), 125);
        assert!(!o.contains(&Point3::new(1.5, 0.0, 0.0)));
    }

    #[test]
    fn a_ray_has_the_intervals_that_dense_points_show() {
        let points: Vec<Point3<f64>> = (0..7)
            .map(|i| {
                let a = f64::from(i);
                Point3::new((a * 1.7).sin() * 0.8, (a * 2.3).cos() * 0.8, (a * 0.9).sin() * 0.7)
            })
            .collect();
        let o = Occupancy::new(&unit_cube(), &points, 0.08, 2);
        let mut intervals = Vec::new();
        let mut hits = 0;
        for k in 0..200 {
            let a = f64::from(k);
            let from = Point3::new(2.0 * (a * 0.37).sin(), 2.0 * (a * 0.61).cos(), 1.5 * (a * 0.23).sin());
            let to = points[k as usize % 7] + Vector3::new(0.1, -0.05, 0.1) * (a * 0.11).sin();
            let d = if k % 10 == 0 { Vector3::z() } else { to - from };
            o.occupied_intervals(&from, &d, 0.1, 2.5, &mut intervals);
            assert!(intervals.windows(2).all(|w| w[0].1 < w[1].0) && intervals.iter().all(|i| i.0 < i.1));
            hits += intervals.len();
            for s in 0..2000 {
                let t = 0.1 + 2.4 * (f64::from(s) + 0.5) / 2000.0;
                let inside = intervals.iter().any(|i| t >= i.0 && t < i.1);
                let near_end = intervals.iter().any(|i| (t - i.0).abs() < 1e-9 || (t - i.1).abs() < 1e-9);
                assert!(near_end || inside == o.contains(&(from + d * t)), "ray {k} at {t}");
            }
        }
        assert!(hits > 100);
        o.occupied_intervals(&Point3::new(f64::NAN, 0.0, 0.0), &Vector3::x(), 0.0, 1.0, &mut intervals);
        assert!(intervals.is_empty());
    }
}
