//! Effects at one position: the searched positions and widths, and their bounds in a fit.

use super::effect::{Coverage, Dimension, Extent, Parameter, amplitude_parameter, shape_parameter};

/// Searched widths of local effects, as shares of the range, each with its number of center positions.
/// chosen: from a hundredth to an eighth of the range; centers are less than a width apart, so no position is
/// missed.
const BUMPS: [(f64, i32); 3] = [(0.012, 90), (0.03, 45), (0.075, 20)];
/// Largest strength, as a multiple of the root mean square effort.
/// chosen: far beyond the drive's effort.
const LARGEST: f64 = 20.0;
/// Least and largest width, as shares of the range.
/// chosen: a few samples, and more than a local effect.
const WIDTHS: [f64; 2] = [0.003, 0.25];
/// Parameters of a local effect: the named strength, position and width.
pub const fn bump_parameters(strength: &'static str) -> [Parameter; 3] {
    [
        amplitude_parameter(strength, Dimension::Effort, false),
        shape_parameter("position", Dimension::Position, true),
        shape_parameter("width", Dimension::Position, false),
    ]
}

/// Whether a local effect reaching `reach` widths acts on a stretch of motion.
pub fn bump_meets(extent: &Extent, shape: &[f64], reach: f64) -> bool {
    Extent::meets_interval(extent.position, shape[1], reach * shape[2])
}

/// Start values of a local effect: zero strength, at all searched positions and widths.
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
pub fn bump_bounds(index: usize, coverage: &Coverage) -> (f64, f64) {
    let (low, high) = coverage.position;
    match index {
        0 => (0.0, LARGEST * coverage.effort_rms),
        1 => (low, high),
        _ => (WIDTHS[0] * (high - low), WIDTHS[1] * (high - low)),
    }
}
