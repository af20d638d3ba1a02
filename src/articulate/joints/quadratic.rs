//! Quadratic model of a robust cost around a motion.

use std::collections::BTreeMap;

use nalgebra::{Matrix6, Point3, Vector3, Vector6};

/// The kind of observation behind a residual. Errors are correlated within one kind, not across kinds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Source {
    /// The surface of state 0.
    Surface0,
    /// The surface of the other state.
    Surface1,
    /// Matches.
    Matches,
}

/// A cube of space: the errors of its residuals of one source may be correlated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Block {
    cell: [i64; 3],
    /// The kind of observation behind its residuals.
    pub source: Source,
}

impl Block {
    /// The block of side `side_m` around a point.
    pub fn block_of(x: &Point3<f64>, side_m: f64, source: Source) -> Self {
        Self { cell: cell_of(x, side_m), source }
    }
}

/// A patch on one side of a surface that is displaced as a whole: place, side, source.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct DisplacedPatch {
    cell: [i64; 3],
    side: usize,
    source: Source,
}

impl DisplacedPatch {
    /// The patch of size `size_m` around a point with a given normal.
    pub fn patch_of(x: &Point3<f64>, normal: &Vector3<f64>, size_m: f64, source: Source) -> Self {
        let axis = normal.iamax();
        Self { cell: cell_of(x, size_m), side: 2 * axis + usize::from(normal[axis] > 0.0), source }
    }
}

fn cell_of(x: &Point3<f64>, side_m: f64) -> [i64; 3] {
    [x.x, x.y, x.z].map(|x| (x / side_m).floor() as i64)
}

/// Quadratic model of the cost around a motion: `cost + 2 g.x + x.H x` for a left perturbation `x = (v, w)`.
/// See docs/method.md (8.5).
#[derive(Clone, Debug)]
pub struct Quadratic {
    /// Information matrix.
    pub information: Matrix6<f64>,
    /// Half the gradient.
    pub gradient: Vector6<f64>,
    /// Robust cost, in independent residuals.
    pub cost: f64,
    /// Number of surface points and matches that agree with the motion (within the robust scale).
    pub inliers: usize,
    /// Number of compared surface points and matches.
    pub tried: usize,
    /// Sum of squared inlier surface distances, square meters.
    pub squared_m2: f64,
    /// Number of inlier surface points.
    pub surface_inliers: usize,
    /// Number of independent residuals.
    pub independent: f64,
    /// For each block of the surface, the sum of rows times residuals; every match is a block of its own.
    pub block_gradients: BTreeMap<Block, Vector6<f64>>,
    /// Changes of the gradient by the displacement of each patch of a surface.
    pub displaced: BTreeMap<DisplacedPatch, Vector6<f64>>,
    /// Changes of the gradient by drawn errors of poses and depth, per draw, where requested.
    pub drawn: Vec<Vector6<f64>>,
}

impl Default for Quadratic {
    fn default() -> Self {
        Self {
            information: Matrix6::zeros(),
            gradient: Vector6::zeros(),
            cost: 0.0,
            inliers: 0,
            tried: 0,
            squared_m2: 0.0,
            surface_inliers: 0,
            independent: 0.0,
            block_gradients: BTreeMap::new(),
            displaced: BTreeMap::new(),
            drawn: Vec::new(),
        }
    }
}

impl Quadratic {
    /// An empty model, with room for `count` draws.
    pub fn with_draws(count: usize) -> Self {
        Self { drawn: vec![Vector6::zeros(); count], ..Self::default() }
    }

    /// Adds one residual `r` (in standard deviations) with its row, robustly, as `share` of an observation;
    /// returns its weight.
    pub fn add_residual(&mut self, r: f64, row: &Vector6<f64>, share: f64, scale: f64, block: Block) -> f64 {
        // Cost and weight of docs/method.md (8.5).
        let k = scale * scale;
        let u = k / (k + r * r);
        let w = share * u * u;
        self.information += row * row.transpose() * w;
        self.gradient += row * (r * w);
        *self.block_gradients.entry(block).or_default() += row * (r * w);
        self.cost += share * r * r * u;
        self.independent += share;
        w
    }

    pub fn merge(mut self, o: Self) -> Self {
        self.information += o.information;
        self.gradient += o.gradient;
        self.cost += o.cost;
        self.inliers += o.inliers;
        self.tried += o.tried;
        self.squared_m2 += o.squared_m2;
        self.surface_inliers += o.surface_inliers;
        self.independent += o.independent;
        for (block, gradient) in o.block_gradients {
            *self.block_gradients.entry(block).or_default() += gradient;
        }
        for (patch, gradient) in o.displaced {
            *self.displaced.entry(patch).or_default() += gradient;
        }
        self.drawn.iter_mut().zip(o.drawn).for_each(|(sum, g)| *sum += g);
        self
    }

    /// Covariance of the gradient due to displacements of the surfaces' patches.
    pub fn displacement_covariance(&self) -> Matrix6<f64> {
        self.displaced.values().map(|g| g * g.transpose()).sum()
    }

    /// Ratio of the squared errors of a free motion to those of independent residuals: the cluster-robust
    /// covariance (Liang and Zeger 1986) over blocks of the surface against the inverse information, averaged
    /// over the six parameters; at least 1. Errors of a reconstructed surface that a block shares do not
    /// average out within it. See docs/method.md (8.10).
    pub fn dispersion(&self) -> f64 {
        let parameters = 6;
        let blocks = self.block_gradients.len();
        let Some(covariance) = self.information.cholesky().map(|c| c.inverse()) else { return 1.0 };
        // No more blocks than parameters: they show no spread.
        if blocks <= parameters {
            return 1.0;
        }
        let spread: Matrix6<f64> = self.block_gradients.values().map(|g| g * g.transpose()).sum();
        let small_sample = blocks as f64 / (blocks - parameters) as f64;
        (small_sample * (covariance * spread).trace() / parameters as f64).max(1.0)
    }
}
