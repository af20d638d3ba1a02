//! Normal equations over windows with separate start states.

use nalgebra::{DMatrix, DVector};

use crate::fit::jackknife::effective_count;

/// Normal equations of one window.
#[derive(Clone, Debug)]
pub struct MultibodyBlock {
    /// Sum of its squared residuals.
    pub cost: f64,
    start: DMatrix<f64>,
    cross: DMatrix<f64>,
    hessian: DMatrix<f64>,
    start_gradient: DVector<f64>,
    gradient: DVector<f64>,
}

impl MultibodyBlock {
    /// Sums residuals and their derivatives: columns by the start state (`states` of them), then by the
    /// parameters.
    pub fn of_residuals(residual: &DVector<f64>, by: &DMatrix<f64>, states: usize) -> Self {
        let products = by.transpose() * by;
        let gradient = by.transpose() * residual;
        let free = by.ncols() - states;
        Self {
            cost: residual.norm_squared(),
            start: products.view((0, 0), (states, states)).into_owned(),
            cross: products.view((0, states), (states, free)).into_owned(),
            hessian: products.view((states, states), (free, free)).into_owned(),
            start_gradient: gradient.rows(0, states).into_owned(),
            gradient: gradient.rows(states, free).into_owned(),
        }
    }

    /// The window's matrix and gradient for the parameters with its start state eliminated, and the inverse
    /// of the start state's matrix.
    fn without_start(&self, damping: f64) -> (DMatrix<f64>, DVector<f64>, DMatrix<f64>) {
        let mut start = self.start.clone();
        for i in 0..start.nrows() {
            start[(i, i)] = start[(i, i)] * (1.0 + damping) + 1e-300;
        }
        let inverse =
            start.try_inverse().unwrap_or_else(|| DMatrix::zeros(self.start.nrows(), self.start.nrows()));
        // (14.11)
        let weighted = self.cross.transpose() * &inverse;
        (&self.hessian - &weighted * &self.cross, &self.gradient - weighted * &self.start_gradient, inverse)
    }
}

/// A step of the parameters and of each window's start state.
pub struct MultibodyStep {
    /// Change of the parameters.
    pub parameters: DVector<f64>,
    /// Change of the start state of each window.
    pub states: Vec<DVector<f64>>,
}

/// Gauss-Newton step damped after Marquardt; `frozen` parameters stay.
pub fn multibody_step(blocks: &[MultibodyBlock], frozen: &[bool], damping: f64) -> Option<MultibodyStep> {
    let n = frozen.len();
    let mut known = DMatrix::zeros(n, n);
    let mut wanted = DVector::zeros(n);
    let mut inverses = Vec::with_capacity(blocks.len());
    for block in blocks {
        let (hessian, gradient, inverse) = block.without_start(damping);
        known += hessian;
        wanted += gradient;
        inverses.push(inverse);
    }
    for i in 0..n {
        if frozen[i] {
            known.row_mut(i).fill(0.0);
            known.column_mut(i).fill(0.0);
            (known[(i, i)], wanted[i]) = (1.0, 0.0);
        } else {
            known[(i, i)] = known[(i, i)] * (1.0 + damping) + 1e-300;
        }
    }
    let parameters = known.cholesky()?.solve(&wanted);
    let states = blocks
        .iter()
        .zip(&inverses)
        .map(|(b, inverse)| inverse * (&b.start_gradient - &b.cross * &parameters))
        .collect();
    Some(MultibodyStep { parameters, states })
}

/// Covariance of the parameters and the number of windows determining each. Only a `share` of a window's
/// residuals counts as independent; where parameters vary more between windows than this predicts, the
/// variation between windows is used (Liang and Zeger 1986).
pub fn cluster_covariance(
    blocks: &[MultibodyBlock],
    frozen: &[bool],
    share: f64,
) -> (DMatrix<f64>, Vec<f64>) {
    let n = frozen.len();
    let reduced: Vec<_> = blocks.iter().map(|b| b.without_start(0.0)).collect();
    let mut known = reduced.iter().fold(DMatrix::zeros(n, n), |sum, (h, ..)| sum + h);
    for i in (0..n).filter(|i| frozen[*i]) {
        known.row_mut(i).fill(0.0);
        known.column_mut(i).fill(0.0);
        known[(i, i)] = 1.0;
    }
    let Some(inverse) = known.cholesky().map(|c| c.inverse()) else {
        return (DMatrix::from_element(n, n, f64::INFINITY), vec![1.0; n]);
    };
    let mut moved = vec![0.0; n];
    let mut shares = vec![(0.0, 0.0); n];
    for (hessian, gradient, _) in &reduced {
        let way = &inverse * gradient;
        let own = &inverse * hessian * &inverse;
        for i in 0..n {
            moved[i] += way[i] * way[i];
            shares[i] = (shares[i].0 + own[(i, i)], shares[i].1 + own[(i, i)].powi(2));
        }
    }
    let wider: Vec<f64> = (0..n).map(|i| (share * moved[i] / inverse[(i, i)]).max(1.0).sqrt()).collect();
    let covariance = DMatrix::from_fn(n, n, |i, j| {
        if frozen[i] || frozen[j] { 0.0 } else { inverse[(i, j)] / share * wider[i] * wider[j] }
    });
    (covariance, shares.iter().map(|(sum, squares)| effective_count(*sum, *squares)).collect())
}
