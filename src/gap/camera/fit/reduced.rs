//! The mixed model with frames and patches eliminated: solutions and evidence of sets of parameters.
//! See docs/method.md (15.6).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::camera::fit::components::VarianceComponents;

/// A system with frames and patches eliminated.
pub struct Reduced {
    pub(super) gram: DMatrix<f64>,
    pub(super) rhs: DVector<f64>,
    pub(super) energy: f64,
    pub(super) log_det: f64,
    pub(super) priors: Vec<f64>,
    /// Variance components of this system.
    pub components: VarianceComponents,
}

/// The solution for a set of parameters.
#[derive(Clone, Debug)]
pub struct Solution {
    /// Values in the order of the subset.
    pub values: DVector<f64>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
    /// Variance components of the unnamed errors.
    pub components: VarianceComponents,
}

impl Reduced {
    /// Solves for a set of columns; all others are zero.
    pub fn solution_of(&self, subset: &[usize]) -> Option<Solution> {
        let n = subset.len();
        let prior = |i: usize| self.priors[subset[i]];
        // In units of the prior deviations the prior is the identity.
        let system = DMatrix::from_fn(n, n, |i, j| {
            self.gram[(subset[i], subset[j])] * prior(i) * prior(j) + f64::from(u8::from(i == j))
        });
        let rhs = DVector::from_fn(n, |i, _| self.rhs[subset[i]] * prior(i));
        let chol = Cholesky::new(system)?;
        let scaled = chol.solve(&rhs);
        let inverse = chol.inverse();
        Some(Solution {
            values: DVector::from_fn(n, |i, _| scaled[i] * prior(i)),
            covariance: DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] * prior(i) * prior(j)),
            components: self.components,
        })
    }

    /// The evidence without the solution, for searches.
    pub fn evidence_of(&self, subset: &[usize]) -> f64 {
        let n = subset.len();
        let prior = |i: usize| self.priors[subset[i]];
        let system = DMatrix::from_fn(n, n, |i, j| {
            self.gram[(subset[i], subset[j])] * prior(i) * prior(j) + f64::from(u8::from(i == j))
        });
        let rhs = DVector::from_fn(n, |i, _| self.rhs[subset[i]] * prior(i));
        Cholesky::new(system).map_or(f64::NEG_INFINITY, |chol| {
            // (15.6)
            -0.5 * (self.energy - rhs.dot(&chol.solve(&rhs)) + self.log_det + log_determinant(&chol))
        })
    }
}

/// The best evidence of a set of columns over the variance components, and the index of its system.
pub fn best_evidence(reduced: &[Reduced], subset: &[usize]) -> (f64, usize) {
    let all: Vec<f64> = reduced.iter().map(|r| r.evidence_of(subset)).collect();
    let i = (0..all.len()).max_by(|&a, &b| all[a].total_cmp(&all[b])).unwrap_or(0);
    (all.get(i).copied().unwrap_or(f64::NEG_INFINITY), i)
}

pub(super) fn log_determinant(chol: &Cholesky<f64, Dyn>) -> f64 {
    2.0 * chol.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>()
}
