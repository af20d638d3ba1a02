//! Effects at one position: where they are looked for, and how far a fit may move them.

use super::effect::Coverage;

/// Positions and widths that a local effect is looked for at.
#[must_use]
pub fn bumps(coverage: &Coverage) -> Vec<(f64, f64)> {
    let (low, high) = coverage.position;
    let range = high - low;
    let mut bumps = Vec::new();
    for (share, count) in [(0.012, 90), (0.03, 45), (0.075, 20)] {
        bumps.extend(
            (0..count).map(|i| (low + range * (f64::from(i) + 0.5) / f64::from(count), share * range)),
        );
    }
    bumps
}

/// Bounds of the parameters (amplitude, position, width) of a local effect.
#[must_use]
pub fn bump_bounds(index: usize, coverage: &Coverage) -> (f64, f64) {
    let (low, high) = coverage.position;
    match index {
        0 => (0.0, 20.0 * coverage.effort_rms),
        1 => (low, high),
        _ => (0.003 * (high - low), 0.25 * (high - low)),
    }
}
