//! The linear mixed model of cell residuals.
//!
//! `y = A x + B f + p + e`: parameters `x` with Gaussian priors; an error `f` of every frame's pose; an error `p` of every
//! patch of the twin's surface, the same in all frames; an error `e` of every cell. Frames, patches and cells are what a
//! camera and a reconstruction get wrong without any effect, and their sizes are found from the data: an effect must
//! explain the residuals better than they do. Frames and patches are eliminated once, so that every set of parameters is
//! judged by a small system.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Vector3};
use rayon::prelude::*;

use super::{cells::Cell, parameter::Parameter};

/// Sizes of the errors without names, standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sizes {
    /// Of the surface of the twin, and of where its parts and joints stand, metres.
    pub patch_m: f64,
    /// Of the camera's pose, metres at the object.
    pub frame_m: f64,
    /// Of a cell, metres.
    pub cell_m: f64,
}

impl Sizes {
    /// The grid that is searched, for a twin that errs by at least `accuracy_m`.
    #[must_use]
    pub fn grid(accuracy_m: f64) -> Vec<Self> {
        let mut all = Vec::new();
        for patch_m in [accuracy_m, 0.0008, 0.002, 0.005].into_iter().filter(|p| *p >= accuracy_m) {
            for frame_m in [0.0002, 0.001, 0.003] {
                for cell_m in [0.0003, 0.001, 0.003] {
                    all.push(Self { patch_m, frame_m, cell_m });
                }
            }
        }
        all
    }
}

/// A parameter with the standard deviation of its prior.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Column {
    /// Parameter.
    pub parameter: Parameter,
    /// One standard deviation of the prior about zero.
    pub prior: f64,
    /// Whether the prior is over the size of the errors of the twin, and so a multiple of [`Sizes::patch_m`].
    pub of_twin: bool,
}

impl Column {
    /// Standard deviation of the prior among errors of given sizes.
    #[must_use]
    pub fn deviation(&self, sizes: &Sizes) -> f64 {
        if self.of_twin { self.prior * sizes.patch_m } else { self.prior }
    }
}

/// Cells and the derivatives of their residuals.
pub struct System {
    /// Columns.
    pub columns: Vec<Column>,
    /// One row a cell: derivatives, then the residual.
    pub matrix: DMatrix<f64>,
    /// Derivatives for the pose of the cell's frame.
    frame_rows: DMatrix<f64>,
    /// First row of each frame, and the number of rows behind the last.
    starts: Vec<usize>,
    patch: Vec<usize>,
    patches: usize,
    variance: Vec<f64>,
}

impl System {
    /// Builds the system from cells and their derivatives; `radius_m` is that of the object.
    #[must_use]
    pub fn new(
        mut cells: Vec<(Cell, f64)>,
        patches: usize,
        columns: Vec<Column>,
        radius_m: f64,
        derivative: impl Fn(Parameter, &Cell) -> f64 + Sync,
    ) -> (Self, Vec<Cell>) {
        cells.sort_by_key(|(c, _)| (c.seen.run, c.seen.frame, c.patch));
        let n = cells.len();
        let rows: Vec<Vec<f64>> =
            cells.par_iter().map(|(c, y)| columns.iter().map(|k| derivative(k.parameter, c)).chain([*y]).collect()).collect();
        let matrix = DMatrix::from_fn(n, columns.len() + 1, |i, j| rows[i][j]);
        let frame_rows = DMatrix::from_fn(n, 6, |i, k| frame_derivative(&cells[i].0, k, radius_m));
        let mut starts = Vec::new();
        for i in 0..n {
            let key = |i: usize| (cells[i].0.seen.run, cells[i].0.seen.frame);
            if i == 0 || key(i) != key(i - 1) {
                starts.push(i);
            }
        }
        starts.push(n);
        let patch = cells.iter().map(|(c, _)| c.patch).collect();
        let variance = cells.iter().map(|(c, _)| c.variance_m2).collect();
        let system = Self { columns, matrix, frame_rows, starts, patch, patches, variance };
        (system, cells.into_iter().map(|(c, _)| c).collect())
    }

    /// Makes cells that stand out count less.
    pub fn soften(&mut self, residuals: &[f64]) {
        let mut off: Vec<f64> = residuals.iter().map(|r| r.abs()).collect();
        if off.is_empty() {
            return;
        }
        let m = off.len() / 2;
        let spread = 1.4826 * *off.select_nth_unstable_by(m, f64::total_cmp).1;
        for (v, r) in self.variance.iter_mut().zip(residuals) {
            let limit = 3.0 * (spread * spread + *v).sqrt();
            if r.abs() > limit {
                *v += r * r - limit * limit;
            }
        }
    }

    /// Eliminates frames and patches.
    #[must_use]
    pub fn reduce(&self, sizes: &Sizes) -> Option<Reduced> {
        let frames = self.starts.len() - 1;
        let (x, fx) = (self.matrix.ncols(), 6 * frames);
        let mut gram = DMatrix::zeros(fx + x, fx + x);
        let mut by_patch = DMatrix::zeros(self.patches, fx + x);
        let mut weights = vec![0.0; self.patches];
        let mut log_det = 0.0;
        for f in 0..frames {
            let (from, count) = (self.starts[f], self.starts[f + 1] - self.starts[f]);
            let mut rows = DMatrix::zeros(count, 6 + x);
            rows.columns_mut(0, 6).copy_from(&self.frame_rows.rows(from, count));
            rows.columns_mut(6, x).copy_from(&self.matrix.rows(from, count));
            let mut scaled = rows.clone();
            for i in 0..count {
                let v = self.variance[from + i] + sizes.cell_m.powi(2);
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
        let precision = sizes.patch_m.powi(-2);
        for (p, w) in weights.iter().enumerate() {
            by_patch.row_mut(p).scale_mut((w + precision).sqrt().recip());
            log_det += (w / precision).ln_1p();
        }
        gram -= by_patch.tr_mul(&by_patch);
        let frame_precision = sizes.frame_m.powi(-2);
        let mut corner = gram.view((0, 0), (fx, fx)).into_owned();
        for i in 0..fx {
            corner[(i, i)] += frame_precision;
        }
        let chol = Cholesky::new(corner)?;
        log_det += log_determinant(&chol) - fx as f64 * frame_precision.ln();
        let mut side = gram.view((0, fx), (fx, x)).into_owned();
        chol.l_dirty().solve_lower_triangular_mut(&mut side);
        let reduced = gram.view((fx, fx), (x, x)) - side.tr_mul(&side);
        let c = x - 1;
        Some(Reduced {
            gram: reduced.view((0, 0), (c, c)).into_owned(),
            rhs: reduced.column(c).rows(0, c).into_owned(),
            energy: reduced[(c, c)],
            log_det,
            priors: self.columns.iter().map(|k| k.deviation(sizes)).collect(),
            sizes: *sizes,
        })
    }

    /// Residuals of the cells less what parameters explain.
    #[must_use]
    pub fn left(&self, subset: &[usize], values: &DVector<f64>) -> Vec<f64> {
        let last = self.matrix.ncols() - 1;
        (0..self.matrix.nrows())
            .map(|i| self.matrix[(i, last)] - subset.iter().zip(values.iter()).map(|(&j, x)| self.matrix[(i, j)] * x).sum::<f64>())
            .collect()
    }
}

/// Derivative of a cell's residual by the pose of its frame about the middle of the view: shifts in metres, turns in
/// metres at the object's radius.
fn frame_derivative(cell: &Cell, k: usize, radius_m: f64) -> f64 {
    let seen = &cell.seen;
    let e = seen.camera.rotation * Vector3::from_fn(|i, _| if i == k % 3 { 1.0 } else { 0.0 });
    let middle = seen.camera * nalgebra::Point3::new(0.0, 0.0, seen.depth_m);
    seen.normal.dot(&if k < 3 { e } else { e.cross(&(seen.point - middle)) / radius_m })
}

fn log_determinant(chol: &Cholesky<f64, Dyn>) -> f64 {
    2.0 * chol.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>()
}

/// A system without frames and patches.
pub struct Reduced {
    gram: DMatrix<f64>,
    rhs: DVector<f64>,
    energy: f64,
    log_det: f64,
    priors: Vec<f64>,
    /// Sizes of the errors that it was made with.
    pub sizes: Sizes,
}

/// A set of parameters, solved.
#[derive(Clone, Debug)]
pub struct Solution {
    /// Logarithm of the evidence.
    pub evidence: f64,
    /// Values in the order of the subset.
    pub values: DVector<f64>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
    /// Sizes of the errors without names.
    pub sizes: Sizes,
}

impl Reduced {
    /// Solves for a set of columns; all others are zero.
    #[must_use]
    pub fn solve(&self, subset: &[usize]) -> Option<Solution> {
        let n = subset.len();
        let prior = |i: usize| self.priors[subset[i]];
        // Scaled by the priors, which makes the prior the identity.
        let system = DMatrix::from_fn(n, n, |i, j| self.gram[(subset[i], subset[j])] * prior(i) * prior(j) + f64::from(u8::from(i == j)));
        let rhs = DVector::from_fn(n, |i, _| self.rhs[subset[i]] * prior(i));
        let chol = Cholesky::new(system)?;
        let scaled = chol.solve(&rhs);
        let evidence = -0.5 * (self.energy - rhs.dot(&scaled) + self.log_det + log_determinant(&chol));
        let inverse = chol.inverse();
        Some(Solution {
            evidence,
            values: DVector::from_fn(n, |i, _| scaled[i] * prior(i)),
            covariance: DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] * prior(i) * prior(j)),
            sizes: self.sizes,
        })
    }

    /// The evidence alone, for searches.
    #[must_use]
    pub fn evidence(&self, subset: &[usize]) -> f64 {
        let n = subset.len();
        let prior = |i: usize| self.priors[subset[i]];
        let system = DMatrix::from_fn(n, n, |i, j| self.gram[(subset[i], subset[j])] * prior(i) * prior(j) + f64::from(u8::from(i == j)));
        let rhs = DVector::from_fn(n, |i, _| self.rhs[subset[i]] * prior(i));
        Cholesky::new(system)
            .map_or(f64::NEG_INFINITY, |chol| -0.5 * (self.energy - rhs.dot(&chol.solve(&rhs)) + self.log_det + log_determinant(&chol)))
    }
}

/// The best evidence of a set of columns over the sizes of the errors, and where.
#[must_use]
pub fn best(reduced: &[Reduced], subset: &[usize]) -> (f64, usize) {
    let all: Vec<f64> = reduced.iter().map(|r| r.evidence(subset)).collect();
    let i = (0..all.len()).max_by(|&a, &b| all[a].total_cmp(&all[b])).unwrap_or(0);
    (all.get(i).copied().unwrap_or(f64::NEG_INFINITY), i)
}
