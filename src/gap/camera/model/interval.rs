//! Estimates with intervals that hold the truth with 95 %.

use crate::judge::finding::ParameterEstimate;

/// Squares of standard deviations that hold a vector of 1, 2, ... components with 95 %.
///
/// derived: chi-square distribution
pub const CHI_SQUARE_95: [f64; 6] = [3.84, 5.99, 7.81, 9.49, 11.07, 12.59];

/// An estimate with half the width of its interval.
#[must_use]
pub fn estimate(name: &str, value: f64, unit: &str, half: f64) -> ParameterEstimate {
    ParameterEstimate {
        name: name.to_owned(),
        value,
        unit: unit.to_owned(),
        interval: (value - half, value + half),
    }
}
