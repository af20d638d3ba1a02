//! Damping of the steps of fits, as a share of the diagonal (Levenberg 1944, Marquardt 1963).

/// Damping after a step that lowers the cost, against that before it.
/// chosen: it falls slower than it rises, so that few trials are lost.
pub const FALL: f64 = 0.2;
/// Damping after a step that does not.
/// chosen: about a decade.
pub const RISE: f64 = 12.0;
/// Least damping.
/// chosen: no step feels it, and the equations stay regular.
pub const LEAST: f64 = 1e-7;
/// Least damping after a step that does not lower the cost.
/// chosen: less would not be felt.
pub const LEAST_RISEN: f64 = 1e-3;
