//! The linear mixed model of the residuals of patches. See docs/method.md (15.5).
//!
//! `y = A x + B f + p + e`: parameters `x` with Gaussian priors; an error `f` of each frame's pose; an error
//! `p` of each patch of the twin's surface, the same in all frames; an error `e` of each patch in each frame.
//! A camera and a reconstruction make these errors without any effect. Their variance components are
//! estimated from the data, and an effect must explain the residuals better than they do. Frames and patches
//! are eliminated once, so every set of parameters is judged by a small system.

use nalgebra::{Cholesky, DMatrix, DVector, Vector3};
use rayon::prelude::*;

use crate::camera::{
    fit::{
        components::VarianceComponents,
        patches::PatchMean,
        reduced::{Reduced, log_determinant},
    },
    model::{parameter::HypothesisParameter, trial::Column},
};
use numeric::statistics::{SIGMAS_PER_MAD, median};

/// The linear system of the patches: residuals and their derivatives.
pub struct System {
    /// Columns.
    pub columns: Vec<Column>,
    /// One row per patch and frame: derivatives, then the residual.
    pub matrix: DMatrix<f64>,
    /// Derivatives with respect to the pose of the frame.
    frame_rows: DMatrix<f64>,
    /// First row of each frame, and at the end the number of rows.
    starts: Vec<usize>,
    patch: Vec<usize>,
    patches: usize,
    variance: Vec<f64>,
}

impl System {
    /// Builds the system from patches and their derivatives; `radius_m` is the object's radius.
    pub fn new(
        mut means: Vec<(PatchMean, f64)>,
        patches: usize,
        columns: Vec<Column>,
        radius_m: f64,
        derivative: impl Fn(HypothesisParameter, &PatchMean) -> f64 + Sync,
    ) -> (Self, Vec<PatchMean>) {
        // Rows of a frame are contiguous: its pose error is one block.
        means.sort_by_key(|(c, _)| (c.seen.run, c.seen.frame, c.patch));
        let n = means.len();
        let rows: Vec<Vec<f64>> = means
            .par_iter()
            .map(|(c, y)| columns.iter().map(|k| derivative(k.parameter, c)).chain([*y]).collect())
            .collect();
        let matrix = DMatrix::from_fn(n, columns.len() + 1, |i, j| rows[i][j]);
        let frame_rows = DMatrix::from_fn(n, 6, |i, k| frame_derivative(&means[i].0, k, radius_m));
        let mut starts = Vec::new();
        for i in 0..n {
            let frame = (means[i].0.seen.run, means[i].0.seen.frame);
            if i == 0 || frame != (means[i - 1].0.seen.run, means[i - 1].0.seen.frame) {
                starts.push(i);
            }
        }
        starts.push(n);
        let patch = means.iter().map(|(c, _)| c.patch).collect();
        let variance = means.iter().map(|(c, _)| c.variance_m2).collect();
        let system = Self { columns, matrix, frame_rows, starts, patch, patches, variance };
        (system, means.into_iter().map(|(c, _)| c).collect())
    }

    /// Lowers the weight of outlying patches.
    pub fn soften_outliers(&mut self, residuals: &[f64]) {
        let Some(off) = median(residuals.iter().map(|r| r.abs()).collect()) else { return };
        let spread = SIGMAS_PER_MAD * off;
        for (v, r) in self.variance.iter_mut().zip(residuals) {
            let limit = 3.0 * (spread * spread + *v).sqrt();
            if r.abs() > limit {
                // The patch stays; its excess is added to its variance.
                *v += r * r - limit * limit;
            }
        }
    }

    /// Eliminates frames and patches.
    pub fn reduced_system(&self, components: &VarianceComponents) -> Option<Reduced> {
        let frames = self.starts.len() - 1;
        let x = self.matrix.ncols();
        let fx = 6 * frames;
        let mut gram = DMatrix::zeros(fx + x, fx + x);
        let mut by_patch = DMatrix::zeros(self.patches, fx + x);
        let mut weights = vec![0.0; self.patches];
        let mut log_det = 0.0;
        for f in 0..frames {
            let from = self.starts[f];
            let count = self.starts[f + 1] - self.starts[f];
            let mut rows = DMatrix::zeros(count, 6 + x);
            rows.columns_mut(0, 6).copy_from(&self.frame_rows.rows(from, count));
            rows.columns_mut(6, x).copy_from(&self.matrix.rows(from, count));
            let mut scaled = rows.clone();
            for i in 0..count {
                let v = self.variance[from + i] + components.rest_m.powi(2);
                log_det += v.ln();
                scaled.row_mut(i).scale_mut(1.0 / v);
                let p = self.patch[from + i];
                weights[p] += 1.0 / v;
                let row = scaled.row(i);
                let mut own = by_patch.row_mut(p);
                own.columns_mut(6 * f, 6).zip_apply(&row.columns(0, 6), |a, b| *a += b);
                own.columns_mut(fx, x).zip_apply(&row.columns(6, x), |a, b| *a += b);
            }
            let block = rows.tr_mul(&scaled);
            gram.view_mut((6 * f, 6 * f), (6, 6)).copy_from(&block.view((0, 0), (6, 6)));
            gram.view_mut((6 * f, fx), (6, x)).copy_from(&block.view((0, 6), (6, x)));
            let mut corner = gram.view_mut((fx, fx), (x, x));
            corner += block.view((6, 6), (x, x));
        }
        // Patches first: each has one error, so their block is diagonal. The same steps give ln det V of
        // (15.6).
        let precision = components.surface_m.powi(-2);
        for (p, w) in weights.iter().enumerate() {
            by_patch.row_mut(p).scale_mut((w + precision).sqrt().recip());
            log_det += (w / precision).ln_1p();
        }
        gram -= by_patch.tr_mul(&by_patch);
        let frame_precision = components.frame_m.powi(-2);
        let mut corner = gram.view((0, 0), (fx, fx)).into_owned();
        for i in 0..fx {
            corner[(i, i)] += frame_precision;
        }
        // Eliminating patches couples their frames: one Cholesky factor for all frames.
        let chol = Cholesky::new(corner)?;
        log_det += log_determinant(&chol) - fx as f64 * frame_precision.ln();
        let mut side = gram.view((0, fx), (fx, x)).into_owned();
        chol.l_dirty().solve_lower_triangular_mut(&mut side);
        let reduced = gram.view((fx, fx), (x, x)) - side.tr_mul(&side);
        // The last column is the residual.
        let c = x - 1;
        Some(Reduced {
            gram: reduced.view((0, 0), (c, c)).into_owned(),
            rhs: reduced.column(c).rows(0, c).into_owned(),
            energy: reduced[(c, c)],
            log_det,
            priors: self.columns.iter().map(|k| k.prior_deviation(components.surface_m)).collect(),
            components: *components,
        })
    }

    /// Residuals of the patches minus their part explained by the parameters.
    pub fn residuals_left(&self, subset: &[usize], values: &DVector<f64>) -> Vec<f64> {
        let last = self.matrix.ncols() - 1;
        (0..self.matrix.nrows())
            .map(|i| {
                self.matrix[(i, last)]
                    - subset.iter().zip(values.iter()).map(|(&j, x)| self.matrix[(i, j)] * x).sum::<f64>()
            })
            .collect()
    }
}

/// Derivative of a patch's residual with respect to its frame's pose, about the middle of the view: shifts in
/// meters, turns in meters of arc at the object's radius.
fn frame_derivative(mean: &PatchMean, k: usize, radius_m: f64) -> f64 {
    let seen = &mean.seen;
    let e = seen.camera.rotation * Vector3::from_fn(|i, _| if i == k % 3 { 1.0 } else { 0.0 });
    // About the camera itself, a small turn would look like a shift.
    let middle = seen.camera * nalgebra::Point3::new(0.0, 0.0, seen.depth_m);
    seen.normal.dot(&if k < 3 { e } else { e.cross(&(seen.point - middle)) / radius_m })
}
