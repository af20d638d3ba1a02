//! Estimates with 95 % intervals.

use crate::judge::finding::ParameterEstimate;

/// An estimate from its value and half the width of its 95 % interval.
pub fn estimate_with_half_width(name: &str, value: f64, unit: &str, half: f64) -> ParameterEstimate {
    ParameterEstimate {
        name: name.to_owned(),
        value,
        unit: unit.to_owned(),
        interval: (value - half, value + half),
    }
}
