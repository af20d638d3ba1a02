//! A dense node-aligned feature grid over the normalised cube `[-1, 1]^3` with trilinear interpolation.

/// Number of features at a node of the segmentation grid (docs/method.md 12.7).
pub(crate) const FEATURES: usize = 20;

/// Where a point lies in a grid of `nodes` nodes a side: x varies fastest, then y, then z.
#[derive(Clone, Copy)]
pub(crate) struct Cell {
    base: usize,
    nodes: usize,
    fraction: [f32; 3],
    /// Node spacings per unit; zero along an axis on which the point was outside and has been clamped.
    slope: [f32; 3],
}

impl Cell {
    /// The cell of a normalised point; a point outside the cube gets the values at the nearest border.
    pub(crate) fn cell_of(nodes: usize, point: [f32; 3]) -> Self {
        let scale = 0.5 * (nodes - 1) as f32;
        let mut corner = [0; 3];
        let mut fraction = [0.0; 3];
        let mut slope = [scale; 3];
        for k in 0..3 {
            let g = (point[k] + 1.0) * scale;
            let inside = g.clamp(0.0, (nodes - 1) as f32);
            // Outside, the value does not change along this axis.
            if inside != g {
                slope[k] = 0.0;
            }
            // The last node belongs to the last cell.
            corner[k] = (inside as usize).min(nodes - 2);
            fraction[k] = inside - corner[k] as f32;
        }
        Self { base: corner[0] + nodes * (corner[1] + nodes * corner[2]), nodes, fraction, slope }
    }

    /// Node index and weight of the eight corners.
    pub(crate) fn corners(&self) -> [(usize, f32); 8] {
        let [a, b, c] = self.fraction;
        std::array::from_fn(|k| {
            (self.node_index(k), axis_weight(k, 0, a) * axis_weight(k, 1, b) * axis_weight(k, 2, c))
        })
    }

    fn node_index(&self, corner: usize) -> usize {
        self.base + (corner & 1) + self.nodes * ((corner >> 1 & 1) + self.nodes * (corner >> 2 & 1))
    }

    /// Interpolates the features into `out` ([`FEATURES`] values).
    pub(crate) fn gather(&self, grid: &[f32], out: &mut [f32]) {
        let mut sum = [0.0f32; FEATURES];
        for (node, weight) in self.corners() {
            for (s, g) in sum.iter_mut().zip(&grid[node * FEATURES..(node + 1) * FEATURES]) {
                *s += weight * g;
            }
        }
        out[..FEATURES].copy_from_slice(&sum);
    }

    /// Turns a gradient by the interpolated features into one by the grid, adds it, and marks the nodes as
    /// touched.
    pub(crate) fn scatter(&self, by_features: &[f32], by_grid: &mut [f32], touched: &mut [bool]) {
        for (node, weight) in self.corners() {
            touched[node] = true;
            for (s, g) in by_grid[node * FEATURES..(node + 1) * FEATURES].iter_mut().zip(by_features) {
                *s += weight * g;
            }
        }
    }

    /// Turns a gradient by the interpolated features into one by the normalised position.
    pub(crate) fn by_position(&self, grid: &[f32], by_features: &[f32]) -> [f32; 3] {
        // The features are contracted first: one number a corner is left to differentiate.
        let corner: [f32; 8] = std::array::from_fn(|k| {
            let node = self.node_index(k);
            grid[node * FEATURES..(node + 1) * FEATURES].iter().zip(by_features).map(|(g, d)| g * d).sum()
        });
        let mut gradient = [0.0; 3];
        for (axis, g) in gradient.iter_mut().enumerate() {
            let u = (axis + 1) % 3;
            let v = (axis + 2) % 3;
            for (k, value) in corner.iter().enumerate() {
                let [weight_u, weight_v] = [u, v].map(|axis| axis_weight(k, axis, self.fraction[axis]));
                let sign = if k >> axis & 1 == 1 { 1.0 } else { -1.0 };
                *g += sign * weight_u * weight_v * value;
            }
            *g *= self.slope[axis];
        }
        gradient
    }
}

/// Weight of a corner along an axis, for a point at `fraction` of the cell's side.
fn axis_weight(corner: usize, axis: usize, fraction: f32) -> f32 {
    if corner >> axis & 1 == 1 { fraction } else { 1.0 - fraction }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_feature_is_exact_with_its_gradient() {
        let nodes = 6;
        let mut grid = vec![0.0; nodes * nodes * nodes * FEATURES];
        let f = |p: [f32; 3]| 0.3 * p[0] - 0.7 * p[1] + 0.2 * p[2] + 0.1;
        for i in 0..nodes * nodes * nodes {
            let at = |k: usize| k as f32 * 2.0 / (nodes - 1) as f32 - 1.0;
            grid[i * FEATURES + 4] = f([at(i % nodes), at(i / nodes % nodes), at(i / nodes / nodes)]);
        }
        let p = [0.13, -0.61, 0.97];
        let mut out = [0.0; FEATURES];
        let cell = Cell::cell_of(nodes, p);
        cell.gather(&grid, &mut out);
        assert!((out[4] - f(p)).abs() < 1e-6);
        let mut by_features = [0.0; FEATURES];
        by_features[4] = 2.0;
        let g = cell.by_position(&grid, &by_features);
        assert!((g[0] - 0.6).abs() < 1e-5 && (g[1] + 1.4).abs() < 1e-5 && (g[2] - 0.4).abs() < 1e-5);
        assert_eq!(Cell::cell_of(nodes, [1.5, 0.0, 0.0]).by_position(&grid, &by_features)[0], 0.0);
        let mut by_grid = vec![0.0; grid.len()];
        let mut touched = vec![false; nodes * nodes * nodes];
        cell.scatter(&by_features, &mut by_grid, &mut touched);
        assert!((by_grid.iter().sum::<f32>() - 2.0).abs() < 1e-6);
        assert_eq!(touched.iter().filter(|t| **t).count(), 8);
    }
}
