//! Uncertainty of parameters: from the residuals, and from how far the parameters move without single
//! witnesses. See docs/method.md (14.13).

use nalgebra::{DMatrix, DVector};

use crate::{
    fit::{problem::Problem, smooth::Trace},
    record::log::Span,
};
use numeric::statistics::chi_square_99;

/// A witness with more than this share of a parameter's information is its only one.
/// derived: more than all others together.
const SOLE: f64 = 0.5;
/// Numbers of classes the windows are ranked into, per coordinate.
/// derived: the fewest showing a difference at all, and twice as many.
const RANKS: [usize; 2] = [2, 4];

/// Contribution of one or several windows to the normal equations of the parameters, start states eliminated.
#[derive(Clone)]
pub struct Witness {
    /// Term of the matrix.
    pub hessian: DMatrix<f64>,
    /// Term of the gradient.
    pub gradient: DVector<f64>,
}

/// Groups of windows under similar conditions, separately for each direction of motion. A machine's own
/// errors depend on the position (ripple, spots), the speed (lag, friction), the effort (flexibility, gain),
/// the time since the start and the run (heat). Effects beyond the catalog repeat in similar windows, so a
/// group is one witness of a parameter, not many: cluster-robust errors (Liang and Zeger 1986).
pub fn alike_windows(problem: &Problem) -> Vec<Vec<usize>> {
    let windows = &problem.windows;
    let coordinates: [&dyn Fn(&Span) -> f64; 4] = [
        &|w| window_mean(problem, w, |t| &t.position, |q| *q),
        &|w| window_mean(problem, w, |t| &t.velocity, |v| v.abs()),
        &|w| window_mean(problem, w, |t| &t.effort, |u| u.abs()),
        &|w| w.start as f64,
    ];
    // 1 where the position decreases over the window.
    let mut back = Vec::with_capacity(windows.len());
    for w in windows {
        let positions = window_samples(problem, w, |t| &t.position);
        back.push(usize::from(positions.last() < positions.first()));
    }
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for coordinate in coordinates {
        let ranks = value_ranks(&windows.iter().map(coordinate).collect::<Vec<_>>());
        let group = |count: usize, w: usize| 2 * (ranks[w] * count / windows.len()) + back[w];
        groups.extend(RANKS.map(|count| (0..windows.len()).map(|w| group(count, w)).collect()));
    }
    if problem.logs.len() > 1 {
        groups.push(windows.iter().zip(&back).map(|(w, back)| 2 * w.log + back).collect());
    }
    groups
}

/// Values of one quantity of the trace within a window.
fn window_samples<'p>(problem: &'p Problem, w: &Span, of: fn(&Trace) -> &Vec<f64>) -> &'p [f64] {
    &of(&problem.traces[w.log])[w.start..w.start + w.len]
}

/// Mean of one quantity of the trace over a window.
fn window_mean(problem: &Problem, w: &Span, of: fn(&Trace) -> &Vec<f64>, size: fn(&f64) -> f64) -> f64 {
    window_samples(problem, w, of).iter().map(size).sum::<f64>() / w.len.max(1) as f64
}

/// Rank of each value; equal values are ranked in their order.
fn value_ranks(values: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let mut ranks = vec![0; order.len()];
    order.iter().enumerate().for_each(|(rank, &of)| ranks[of] = rank);
    ranks
}

/// Covariance of the parameters and the number of witnesses of each. The covariance is the inverse of
/// `matrix`, widened where the parameters move by more if single witnesses are left out (a jackknife of one
/// Gauss-Newton step). Each window is a witness. For each of the `groups` (a group number per window), whole
/// groups are witnesses instead if errors are known to `repeat`, or if leaving out groups moves the
/// parameters by more than chance. The largest widening is used.
pub fn jackknife_covariance(
    mut matrix: DMatrix<f64>,
    windows: &[Witness],
    groups: &[Vec<usize>],
    repeat: bool,
    frozen: &[bool],
) -> (DMatrix<f64>, Vec<f64>) {
    let n = matrix.nrows();
    for i in (0..n).filter(|&i| frozen[i]) {
        matrix[(i, i)] = 1.0;
    }
    // Undetermined parameters have no finite interval.
    let Some(mut c) = matrix.clone().cholesky().map(|c| c.inverse()) else {
        return (DMatrix::from_element(n, n, f64::INFINITY), vec![1.0; n]);
    };
    // (14.13): residuals other than white noise move a parameter by more than its variance predicts.
    let width = |moved: &[f64], i: usize| Some((moved[i] / c[(i, i)]).sqrt()).filter(|w| w.is_finite());
    let (moved, mut witnesses) = squared_moves(&matrix, &c, windows);
    let mut wider: Vec<f64> = (0..n).map(|i| width(&moved, i).unwrap_or(1.0).max(1.0)).collect();
    let by_windows = wider.clone();
    for group in groups {
        let (moved, count) = squared_moves(&matrix, &c, &pooled_witnesses(windows, group));
        for i in 0..n {
            // A variance from few groups is uncertain: only beyond the quantile does it surely differ.
            // Leaving out one of k values moves a mean by k / (k - 1) times its weight.
            let freedom = (count[i] - 1.0).max(1.0);
            let jackknife = (freedom + 1.0) / freedom;
            let by_chance = if repeat {
                0.0
            } else {
                by_windows[i] * jackknife * (chi_square_99(freedom) / freedom).sqrt()
            };
            if let Some(width) = width(&moved, i).filter(|w| *w > wider[i].max(by_chance)) {
                (wider[i], witnesses[i]) = (width, count[i]);
            }
        }
    }
    for i in 0..n {
        for j in 0..n {
            // Rows and columns are scaled alike, so correlations stay.
            c[(i, j)] = if frozen[i] || frozen[j] { 0.0 } else { c[(i, j)] * wider[i] * wider[j] };
        }
    }
    (c, witnesses)
}

/// Number of equal shares with the same sum and sum of squares; 1 if all are zero.
pub(super) fn effective_count(sum: f64, squares: f64) -> f64 {
    if squares > 0.0 { sum * sum / squares } else { 1.0 }
}

/// The witnesses of each group summed into one.
fn pooled_witnesses(windows: &[Witness], groups: &[usize]) -> Vec<Witness> {
    let mut pools: Vec<Option<Witness>> = vec![None; groups.iter().max().map_or(0, |m| m + 1)];
    for (window, &group) in windows.iter().zip(groups) {
        match &mut pools[group] {
            Some(pool) => {
                pool.hessian += &window.hessian;
                pool.gradient += &window.gradient;
            }
            none => *none = Some(window.clone()),
        }
    }
    pools.into_iter().flatten().collect()
}

/// Sum of the squared moves of each parameter as each witness is left out, and the parameter's number of
/// witnesses; `c` is the inverse of `matrix`.
fn squared_moves(matrix: &DMatrix<f64>, c: &DMatrix<f64>, witnesses: &[Witness]) -> (Vec<f64>, Vec<f64>) {
    let n = matrix.nrows();
    let mut moved = vec![0.0; n];
    let mut shares = vec![(0.0, 0.0); n];
    for Witness { hessian, gradient } in witnesses {
        // At the optimum the gradient of the others is minus this one's, so one solve gives the step without
        // it, up to the sign.
        let without = (matrix - hessian).cholesky().map_or_else(|| c * gradient, |rest| rest.solve(gradient));
        let known = c * hessian * c;
        let within = c * gradient;
        for i in 0..n {
            // Without a parameter's only witness nothing is left to compare.
            let way = if known[(i, i)] > SOLE * c[(i, i)] { within[i] } else { without[i] };
            moved[i] += way * way;
            shares[i] = (shares[i].0 + known[(i, i)], shares[i].1 + known[(i, i)] * known[(i, i)]);
        }
    }
    (moved, shares.iter().map(|(sum, squares)| effective_count(*sum, *squares)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mean of `n` readings, each with its error: one parameter, unit weights.
    fn mean(errors: &[f64]) -> (DMatrix<f64>, Vec<Witness>) {
        let own = |e: &f64| Witness {
            hessian: DMatrix::from_element(1, 1, 1.0),
            gradient: DVector::from_element(1, *e),
        };
        (DMatrix::from_element(1, 1, errors.len() as f64), errors.iter().map(own).collect())
    }

    #[test]
    fn errors_that_repeat_by_group_widen_what_independent_ones_do_not() {
        // Ten windows a place, four places: +s, -s, +s, -s at all windows of a place.
        let errors: Vec<f64> = (0..40).map(|k| if k / 10 % 2 == 0 { 1.0 } else { -1.0 }).collect();
        let groups: Vec<usize> = (0..40).map(|k| k / 10).collect();
        let (matrix, windows) = mean(&errors);
        let variance = |groups: &[Vec<usize>]| {
            jackknife_covariance(matrix.clone(), &windows, groups, false, &[false]).0[(0, 0)]
        };
        // As 40 independent readings: 1 / 40. As four of the size 1: 1 / 4, times (4 / 3)^2 of the jackknife.
        assert!((variance(&[]) * 40.0 - 1.0).abs() < 0.1, "{}", variance(&[]));
        let wide = variance(std::slice::from_ref(&groups));
        assert!((wide - 0.25 * 16.0 / 9.0).abs() < 1e-9, "{wide}");
        let count =
            jackknife_covariance(matrix.clone(), &windows, std::slice::from_ref(&groups), true, &[false]).1
                [0];
        assert!((count - 4.0).abs() < 1e-9, "{count}");
        // Errors that differ within a place are no more than those of windows.
        let within: Vec<f64> = (0..40).map(|k| if k % 2 == 0 { 1.0 } else { -1.0 }).collect();
        let (matrix, windows) = mean(&within);
        let narrow = jackknife_covariance(matrix, &windows, &[groups], true, &[false]).0[(0, 0)];
        assert!((narrow * 40.0 - 1.0).abs() < 0.1, "{narrow}");
    }
}
