//! Node-aligned regular grids in the world frame, with trilinear interpolation.

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::{SceneBox, bytes::Plain};

/// Values at the nodes `origin + spacing_m * (x, y, z)`; x varies fastest: `index = x + nx * (y + ny * z)`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound(serialize = "T: Plain", deserialize = "T: Plain"))]
pub struct Grid3<T> {
    /// World position of node (0, 0, 0), meters.
    pub origin: Point3<f64>,
    /// Distance between neighboring nodes, meters.
    pub spacing_m: f64,
    /// Number of nodes along x, y, z.
    pub dims: [usize; 3],
    /// One value a node.
    #[serde(with = "crate::bytes")]
    pub values: Vec<T>,
}

impl<T: Clone> Grid3<T> {
    /// A grid over the whole scene cube, `nodes` along each axis, filled with `value`.
    pub fn over_scene(scene: &SceneBox, nodes: usize, value: T) -> Self {
        let origin = scene.to_world(&Point3::new(-1.0, -1.0, -1.0));
        Self {
            origin,
            spacing_m: scene.side_m() / (nodes - 1) as f64,
            dims: [nodes; 3],
            values: vec![value; nodes * nodes * nodes],
        }
    }
}

impl<T> Grid3<T> {
    /// World position of a node, meters.
    pub fn node_position(&self, x: usize, y: usize, z: usize) -> Point3<f64> {
        self.origin + Vector3::new(x as f64, y as f64, z as f64) * self.spacing_m
    }

    /// Index of a node in `values`.
    pub fn index(&self, x: usize, y: usize, z: usize) -> usize {
        x + self.dims[0] * (y + self.dims[1] * z)
    }

    /// Coordinates of the node with the given index.
    pub fn coordinates(&self, index: usize) -> [usize; 3] {
        let [nx, ny, _] = self.dims;
        [index % nx, index / nx % ny, index / (nx * ny)]
    }

    /// World position of the node with the given index, meters.
    pub fn position_of_index(&self, index: usize) -> Point3<f64> {
        let [x, y, z] = self.coordinates(index);
        self.node_position(x, y, z)
    }

    /// The node nearest to a point; `None` outside the grid by more than half a spacing.
    pub fn nearest_node(&self, point: &Point3<f64>) -> Option<usize> {
        let g = (point - self.origin) / self.spacing_m;
        let mut c = [0; 3];
        for k in 0..3 {
            let r = g[k] + 0.5;
            // Negated, so NaN counts as outside.
            if !(r >= 0.0 && r < self.dims[k] as f64) {
                return None;
            }
            c[k] = r as usize;
        }
        Some(self.index(c[0], c[1], c[2]))
    }
}

/// The cell of a point, clamped to the grid.
struct GridCell {
    /// Its lowest node.
    base: [usize; 3],
    /// Position of the point in it along each axis, `[0, 1]`.
    fractions: [f32; 3],
    /// Whether the point was inside the grid along each axis.
    inside: [bool; 3],
}

fn cell_of<T>(grid: &Grid3<T>, point: &Point3<f64>) -> GridCell {
    let g = (point - grid.origin) / grid.spacing_m;
    let mut base = [0; 3];
    let mut fractions = [0.0; 3];
    let mut inside = [true; 3];
    for k in 0..3 {
        let last = (grid.dims[k] - 1) as f64;
        let x = g[k].clamp(0.0, last);
        inside[k] = g[k] >= 0.0 && g[k] <= last;
        // The last node belongs to the cell before it.
        let b = (x as usize).min(grid.dims[k].saturating_sub(2));
        base[k] = b;
        fractions[k] = (x - b as f64) as f32;
    }
    GridCell { base, fractions, inside }
}

impl<T> Grid3<T> {
    /// Whether `does` holds at all eight nodes of the cell around a point; false outside the grid.
    pub fn all_around(&self, point: &Point3<f64>, does: impl Fn(&T) -> bool) -> bool {
        let GridCell { base: [x, y, z], inside, .. } = cell_of(self, point);
        let inside = inside == [true; 3] && self.dims.iter().all(|&n| n > 1);
        let mut corners = (0..8).map(|k| self.index(x + (k & 1), y + (k >> 1 & 1), z + (k >> 2)));
        inside && corners.all(|i| does(&self.values[i]))
    }
}

impl Grid3<bool> {
    /// Whether all eight nodes of the cell around a point are true; false outside the grid.
    pub fn holds_around(&self, point: &Point3<f64>) -> bool {
        self.all_around(point, |holds| *holds)
    }
}

fn lerp(p: f32, q: f32, t: f32) -> f32 {
    p + (q - p) * t
}

impl Grid3<f32> {
    /// Trilinear value; a point outside takes the value at the nearest border.
    pub fn value_at(&self, point: &Point3<f64>) -> f32 {
        let GridCell { base: [x, y, z], fractions: [a, b, c], .. } = cell_of(self, point);
        let i = self.index(x, y, z);
        let along_x = |i: usize| lerp(self.values[i], self.values[i + 1], a);
        let dy = self.dims[0];
        let dz = self.dims[0] * self.dims[1];
        let in_layer = |i: usize| lerp(along_x(i), along_x(i + dy), b);
        lerp(in_layer(i), in_layer(i + dz), c)
    }

    /// Trilinear value and its gradient per meter: the exact derivative of the interpolant, zero along an
    /// axis on which the point is outside and the value clamped.
    pub fn sample_with_gradient(&self, point: &Point3<f64>) -> (f32, Vector3<f32>) {
        let GridCell { base: [x, y, z], fractions: [a, b, c], inside } = cell_of(self, point);
        let i = self.index(x, y, z);
        let dy = self.dims[0];
        let dz = self.dims[0] * self.dims[1];
        let v = &self.values;
        let v000 = v[i];
        let v100 = v[i + 1];
        let v010 = v[i + dy];
        let v110 = v[i + dy + 1];
        let v001 = v[i + dz];
        let v101 = v[i + dz + 1];
        let v011 = v[i + dz + dy];
        let v111 = v[i + dz + dy + 1];
        // Along x, then y, then z; the differences before each step are the derivative.
        let x00 = lerp(v000, v100, a);
        let x10 = lerp(v010, v110, a);
        let x01 = lerp(v001, v101, a);
        let x11 = lerp(v011, v111, a);
        let y0 = lerp(x00, x10, b);
        let y1 = lerp(x01, x11, b);
        let gx = lerp(lerp(v100 - v000, v110 - v010, b), lerp(v101 - v001, v111 - v011, b), c);
        let gy = lerp(x10 - x00, x11 - x01, c);
        let gz = y1 - y0;
        let h = self.spacing_m as f32;
        let keep = |g: f32, k: usize| if inside[k] { g / h } else { 0.0 };
        (lerp(y0, y1, c), Vector3::new(keep(gx, 0), keep(gy, 1), keep(gz, 2)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_holds_where_all_its_nodes_do() {
        let scene = SceneBox::around_box(&Point3::new(0.0, 0.0, 0.0), &Point3::new(1.0, 1.0, 1.0));
        let mut g = Grid3::over_scene(&scene, 5, true);
        let node = g.index(2, 2, 2);
        g.values[node] = false;
        let at = |x: f64, y: f64, z: f64| g.origin + Vector3::new(x, y, z) * g.spacing_m;
        assert!(g.holds_around(&at(0.5, 0.5, 0.5)) && g.holds_around(&at(4.0, 4.0, 4.0)));
        assert!(!g.holds_around(&at(1.5, 1.5, 1.5)) && !g.holds_around(&at(2.5, 2.5, 2.5)));
        assert!(g.holds_around(&at(3.5, 2.5, 2.5)) && !g.holds_around(&at(-0.1, 0.5, 0.5)));
    }

    #[test]
    fn a_linear_field_is_exact_at_every_point() {
        let scene = SceneBox::around_box(&Point3::new(-0.2, 0.1, 0.0), &Point3::new(0.4, 0.3, 0.5));
        let mut g = Grid3::over_scene(&scene, 21, 0.0f32);
        let f = |p: &Point3<f64>| 2.0 * p.x - 3.0 * p.y + 0.5 * p.z + 0.25;
        for i in 0..g.values.len() {
            g.values[i] = f(&g.position_of_index(i)) as f32;
        }
        for p in [Point3::new(0.1, 0.2, 0.3), Point3::new(0.39, 0.12, 0.01), g.node_position(3, 4, 5)] {
            let (v, d) = g.sample_with_gradient(&p);
            assert!((f64::from(v) - f(&p)).abs() < 1e-5);
            assert_eq!(v, g.value_at(&p));
            assert!((d - Vector3::new(2.0, -3.0, 0.5)).norm() < 1e-3);
        }
        assert_eq!(g.nearest_node(&g.node_position(3, 4, 5)), Some(g.index(3, 4, 5)));
        assert_eq!(g.nearest_node(&(g.origin - Vector3::x())), None);
    }
}
