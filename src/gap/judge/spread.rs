//! Uncertainty of fitted parameters, and their intervals.

use nalgebra::{DMatrix, DVector};

use numeric::statistics::{HALF_WIDTH_95, chi_square_95};

/// Uncertainty of the parameters.
#[derive(Clone, Debug)]
pub struct Spread {
    /// Covariance of all free parameters.
    pub covariance: DMatrix<f64>,
    /// Number of windows determining each of them.
    pub witnesses: Vec<f64>,
}

impl Spread {
    /// Half width of the 95 % interval of a number with this gradient with respect to the parameters from
    /// `first` on.
    #[must_use]
    pub fn half_width(&self, first: usize, gradient: &[f64]) -> f64 {
        let n = gradient.len();
        let covariance = self.covariance.view((first, first), (n, n));
        let variance: f64 = (0..n)
            .flat_map(|i| (0..n).map(move |j| (i, j)))
            .map(|(i, j)| gradient[i] * covariance[(i, j)] * gradient[j])
            .sum();
        let shown = (0..n).filter(|i| gradient[*i] != 0.0);
        half_width(self.fewest_witnesses(shown.map(|i| first + i)) - 1.0) * variance.max(0.0).sqrt()
    }

    /// Distance of the parameters from `first` on when changed by `off`, jointly: 1 is the border of their
    /// 95 % region. For a single parameter it is in half widths of its interval.
    #[must_use]
    pub fn distance_in_region(&self, first: usize, off: &[f64]) -> f64 {
        let n = off.len();
        let off = DVector::from_column_slice(off);
        let covariance = self.covariance.view((first, first), (n, n)).into_owned();
        // A frozen parameter has zero variance; an undetermined one is infinitely uncertain.
        let is_fixed = covariance[(0, 0)] <= 0.0 && off.norm() > 0.0;
        let Some(known) = covariance.cholesky() else { return if is_fixed { f64::INFINITY } else { 0.0 } };
        let region = chi_square_95(n as f64) / chi_square_95(1.0);
        let away = (off.dot(&known.solve(&off)) / region).sqrt();
        (away / half_width(self.fewest_witnesses(first..first + n) - 1.0)).max(0.0)
    }

    /// Smallest number of windows determining any of these parameters; it limits the interval.
    fn fewest_witnesses(&self, of: impl Iterator<Item = usize>) -> f64 {
        of.map(|i| self.witnesses[i]).fold(f64::INFINITY, f64::min)
    }
}

/// Widens a covariance by an error common to all n witnesses. Each witness has its own error of variance n C,
/// with C the variance of their mean. A common error is not visible in their differences and is assumed as
/// large: C + n C. See docs/method.md 14.11.
#[must_use]
pub fn with_common(covariance: &DMatrix<f64>, witnesses: &[f64]) -> DMatrix<f64> {
    covariance.map_with_location(|i, j, c| c * ((1.0 + witnesses[i]) * (1.0 + witnesses[j])).sqrt())
}

/// Terms of the series of [`half_width`] in 1 / n: coefficients of odd powers of z, and a divisor.
/// derived: Abramowitz and Stegun 26.7.5.
const TERMS: [([f64; 4], f64); 3] =
    [([1.0, 1.0, 0.0, 0.0], 4.0), ([3.0, 16.0, 5.0, 0.0], 96.0), ([-15.0, 17.0, 19.0, 3.0], 384.0)];

/// Half width of a 95 % interval in estimated standard deviations, for at least three degrees of freedom:
/// Student's quantile (Abramowitz and Stegun 26.7.5). See docs/method.md (14.18).
fn half_width(freedom: f64) -> f64 {
    let z = HALF_WIDTH_95;
    let n = freedom.max(3.0);
    let of = |powers: [f64; 4]| powers.iter().rev().fold(0.0, |sum, c| sum * z * z + c) * z;
    let [first, second, third] = TERMS;
    z + of(first.0) / (first.1 * n) + of(second.0) / (second.1 * n * n) + of(third.0) / (third.1 * n * n * n)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strengths_that_are_unsure_one_by_one_are_sure_together() {
        // Two that hide each other: their sum is known to 0.1, their difference to 10.
        let sum = 0.01;
        let difference = 100.0;
        let own = 0.25 * (sum + difference);
        let mixed = 0.25 * (sum - difference);
        let covariance = DMatrix::from_row_slice(2, 2, &[own, mixed, mixed, own]);
        let spread = Spread { covariance, witnesses: vec![1e6; 2] };
        assert!(spread.distance_in_region(0, &[1.0]) < 0.2 && spread.distance_in_region(1, &[1.0]) < 0.2);
        assert!(
            spread.distance_in_region(0, &[1.0, 1.0]) > 5.0,
            "{}",
            spread.distance_in_region(0, &[1.0, 1.0])
        );
        assert!((spread.distance_in_region(0, &[spread.half_width(0, &[1.0])]) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn what_witnesses_have_in_common_is_as_large_as_what_differs() {
        // Four witnesses, each off by a deviation of 2: their mean by 1, and what none of them shows by 2.
        let covariance = DMatrix::from_row_slice(2, 2, &[1.0, 0.5, 0.5, 1.0]);
        let wide = with_common(&covariance, &[4.0, 4.0]);
        assert!((wide[(0, 0)] - 5.0).abs() < 1e-12 && (wide[(0, 1)] - 2.5).abs() < 1e-12, "{wide}");
    }
}
