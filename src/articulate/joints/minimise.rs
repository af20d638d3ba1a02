//! Damped least squares (Levenberg 1944, Marquardt 1963) over any model with parameters.

use nalgebra::{DMatrix, DVector, Vector6};

use geometry::{Pose, shift_and_turn};

/// Factor of the damping after a step to a lower cost.
///
/// chosen: about half a decade
const DAMPING_FALL: f64 = 0.3;
/// Factor of the damping after any other step.
///
/// chosen: about a decade: few trials are lost
const DAMPING_RISE: f64 = 8.0;
/// Damping at the start, as a share of the diagonal.
///
/// chosen: small, as every fit starts near its minimum
const FIRST_DAMPING: f64 = 1e-4;
/// Largest damping: beyond, no step can lower the cost.
///
/// chosen: steps are then below the rounding of parameters
const MOST_DAMPING: f64 = 1e8;
/// Least fall of the cost in a step for another to follow, as a share of the cost.
///
/// chosen: of costs of thousands of residuals it leaves parameters a thousandth of their standard
/// deviation from the minimum
const LEAST_GAIN: f64 = 1e-9;

/// Minimises a cost and returns the model and its linearization at the end. `equations` gives information and
/// half the gradient in the model's parameters.
pub(crate) fn minimise<M, Q>(
    mut model: M,
    iterations: usize,
    linearise: impl Fn(&M) -> Q,
    cost: impl Fn(&Q) -> f64,
    equations: impl Fn(&M, &Q) -> (DMatrix<f64>, DVector<f64>),
    stepped: impl Fn(&M, &DVector<f64>) -> M,
) -> (M, Q) {
    let mut q = linearise(&model);
    let mut damping = FIRST_DAMPING;
    for _ in 0..iterations {
        let (h, g) = equations(&model, &q);
        let mut damped = h.clone();
        // The 1e-12 keeps an unobserved parameter in place and the matrix factorizable.
        (0..h.nrows()).for_each(|k| damped[(k, k)] += damping * h[(k, k)] + 1e-12);
        let Some(step) = damped.cholesky().map(|c| -c.solve(&g)) else { break };
        let next = stepped(&model, &step);
        let trial = linearise(&next);
        let before = cost(&q);
        let after = cost(&trial);
        if after <= before {
            (model, q, damping) = (next, trial, damping * DAMPING_FALL);
            if before - after < LEAST_GAIN * before.max(1e-12) {
                break;
            }
        } else {
            damping *= DAMPING_RISE;
            if damping > MOST_DAMPING {
                break;
            }
        }
    }
    (model, q)
}

/// Step of central differences of motions by parameters of about one: radians, meters.
///
/// chosen: near the cube root of the rounding of a double: it balances rounding and curvature
pub(crate) const DIFFERENCE: f64 = 1e-6;

/// Left perturbation (translation 3, rotation 3) from a motion to one near it.
pub(crate) fn left_difference(to: &Pose, from: &Pose) -> Vector6<f64> {
    shift_and_turn(&(to * from.inverse()))
}
