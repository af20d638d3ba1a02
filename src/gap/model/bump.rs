//! Effects at one position: where they are looked for, and how far a fit may move them.

use super::effect::{Coverage, Dimension, Extent, Parameter, amplitude_parameter, shape_parameter};

/// Searched widths of local effects, as shares of the range, each with its number of centers.
/// chosen: from a hundredth to an eighth of the range; centers lie less than a width apart: no place falls
/// between two bumps.
const BUMPS: [(f64, i32); 3] = [(0.012, 90), (0.03, 45), (0.075, 20)];
/// Largest strength, in efforts (root mean square).
/// chosen: far beyond the drive's effort.
const LARGEST: f64 = 20.0;
/// Least and largest width, as shares of the range.
/// chosen: a few samples, and a width beyond local.
const WIDTHS: [f64; 2] = [0.003, 0.25];
/// Parameters of a local effect of a strength.
#[must_use]
pub const fn bump_parameters(strength: &'static str) -> [Parameter; 3] {
    [
        amplitude_parameter(strength, Dimension::Effort, false),
        shape_parameter("position", Dimension::Position, true),
        shape_parameter("width", Dimension::Position, false),
    ]
}

/// Whether a local effect with a reach of so many widths acts on a stretch of motion.
#[must_use]
pub fn bump_meets(extent: &Extent, shape: &[f64], reach: f64) -> bool {
    Extent::meets_interval(extent.position, shape[1], reach * shape[2])
}

/// Starting points of a local effect: no strength, at positions with widths.
#[must_use]
pub fn bump_starts(coverage: &Coverage) -> Vec<Vec<f64>> {
    let (low, high) = coverage.position;
    let range = high - low;
    let mut bumps = Vec::new();
    for (share, count) in BUMPS {
        bumps.extend(
            (0..count)
                .map(|i| vec![0.0, low + range * (f64::from(i) + 0.5) / f64::from(count), share * range]),
        );
    }
    bumps
}

/// Bounds of the parameters (amplitude, position, width) of a local effect.
#[must_use]
pub fn bump_bounds(index: usize, coverage: &Coverage) -> (f64, f64) {
    let (low, high) = coverage.position;
    match index {
        0 => (0.0, LARGEST * coverage.effort_rms),
        1 => (low, high),
        _ => (WIDTHS[0] * (high - low), WIDTHS[1] * (high - low)),
    }
}
