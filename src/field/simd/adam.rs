//! Adam's update.

use super::lanes::Lanes;
use crate::{ADAM_BETAS, ADAM_EPSILON};

/// Coefficients of one step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AdamStep {
    /// `learning_rate sqrt(1 - beta2^t) / (1 - beta1^t)`.
    rate: f32,
    /// `epsilon sqrt(1 - beta2^t)`.
    epsilon: f32,
    /// Decay of the first and of the second moment.
    betas: (f32, f32),
}

impl AdamStep {
    /// Coefficients of step `t`, counted from 1, with [`ADAM_BETAS`].
    pub(crate) fn new(learning_rate: f32, t: u64) -> Self {
        Self::with_betas(learning_rate, t, ADAM_BETAS)
    }

    /// As [`Self::new`], with other decays of the moments.
    pub(crate) fn with_betas(learning_rate: f32, t: u64, betas: (f32, f32)) -> Self {
        let power = |beta: f32| f64::from(beta).powf(t as f64);
        let second = (1.0 - power(betas.1)).sqrt();
        let rate = f64::from(learning_rate) * second / (1.0 - power(betas.0));
        Self { rate: rate as f32, epsilon: (f64::from(ADAM_EPSILON) * second) as f32, betas }
    }
}

/// Smaller first moments are set to 0: they would move a parameter by less than `1e-30 / epsilon = 1e-15` and
/// become slow denormal numbers. chosen: above the smallest normal number
const SMALLEST_FIRST: f32 = 1e-30;
/// The same for second moments; their roots are far below epsilon. chosen: above the smallest normal number
const SMALLEST_SECOND: f32 = 1e-37;

/// `m = b1 m + (1 - b1) g`, `v = b2 v + (1 - b2) g^2`, `p -= rate m / (sqrt(v) + epsilon)`; sets the gradient
/// to 0.
///
/// # Panics
/// If the lengths differ.
#[inline(always)]
pub(super) fn update<S: Lanes>(
    s: S,
    step: AdamStep,
    params: &mut [f32],
    first: &mut [f32],
    second: &mut [f32],
    gradient: &mut [f32],
) {
    let n = params.len();
    assert!(first.len() == n && second.len() == n && gradient.len() == n);
    let whole = n / S::N * S::N;
    // SAFETY: `i + N <= n` for every i, and all four slices have n floats.
    unsafe {
        for i in (0..whole).step_by(S::N) {
            step_lanes(
                s,
                step,
                params.as_mut_ptr().add(i),
                first.as_mut_ptr().add(i),
                second.as_mut_ptr().add(i),
                gradient.as_mut_ptr().add(i),
            );
        }
    }
    if whole < n {
        // The rest is padded to a whole vector, so that every parameter sees the same operations.
        let mut tail = [[0.0f32; 16]; 4];
        for (copy, from) in tail.iter_mut().zip([&*params, &*first, &*second, &*gradient]) {
            copy[..n - whole].copy_from_slice(&from[whole..]);
        }
        let [p, m, v, g] = &mut tail;
        // SAFETY: the copies have 16 floats each, at least N.
        unsafe { step_lanes(s, step, p.as_mut_ptr(), m.as_mut_ptr(), v.as_mut_ptr(), g.as_mut_ptr()) };
        for (copy, to) in tail.iter().zip([params, first, second, gradient]) {
            to[whole..].copy_from_slice(&copy[..n - whole]);
        }
    }
}

/// One vector of parameters.
///
/// # Safety
/// N floats are readable and writable at every pointer.
#[inline(always)]
unsafe fn step_lanes<S: Lanes>(
    s: S,
    step: AdamStep,
    params: *mut f32,
    first: *mut f32,
    second: *mut f32,
    gradient: *mut f32,
) {
    // SAFETY: the caller's promise.
    unsafe {
        // docs/method.md (12.9), with the bias corrections in rate and epsilon.
        let g = s.load(gradient);
        let (b1, b2) = step.betas;
        let m = s.fma(s.load(first), s.splat(b1), s.mul(g, s.splat(1.0 - b1)));
        let v = s.fma(s.load(second), s.splat(b2), s.mul(s.mul(g, g), s.splat(1.0 - b2)));
        let m = s.keep_above(s.abs(m), s.splat(SMALLEST_FIRST), m);
        let v = s.keep_above(v, s.splat(SMALLEST_SECOND), v);
        let update = s.div(s.mul(m, s.splat(step.rate)), s.add(s.sqrt(v), s.splat(step.epsilon)));
        s.store(params, s.sub(s.load(params), update));
        s.store(first, m);
        s.store(second, v);
        s.store(gradient, s.splat(0.0));
    }
}
