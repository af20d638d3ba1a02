//! Damping of the steps of fits, as a share of the matrix diagonal (Levenberg 1944, Marquardt 1963).

/// Factor of the damping after a step to a lower cost.
/// chosen: it falls slower than it rises, to save trials.
pub const FALL: f64 = 0.2;
/// Factor of the damping after any other step.
/// chosen: about a decade.
pub const RISE: f64 = 12.0;
/// Smallest damping.
/// chosen: too small to change a step, but the equations stay regular.
pub const LEAST: f64 = 1e-7;
/// Smallest damping after a step without a lower cost.
/// chosen: less would not change the step.
pub const LEAST_RISEN: f64 = 1e-3;
