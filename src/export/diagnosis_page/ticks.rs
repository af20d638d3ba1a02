//! Round numbers along an axis.

use crate::page::with_true_minus;

/// Round numbers within a range, `about` of them: steps of 1, 2 or 5 times a power of ten.
pub(super) fn round_ticks(low: f64, high: f64, about: usize) -> Vec<f64> {
    let width = high - low;
    // Negated, so a range of NaN has no ticks.
    if !(width > 0.0 && width.is_finite()) {
        return Vec::new();
    }
    let step = round_step(width / about.max(1) as f64);
    let first = (low / step - 1e-9).ceil();
    let last = (high / step + 1e-9).floor();
    // Adding 0 removes the sign of minus zero.
    (0..=(last - first).max(0.0) as usize).map(|i| (first + i as f64) * step + 0.0).collect()
}

/// The smallest round step that is at least four fifths of the wanted one.
fn round_step(wanted: f64) -> f64 {
    let power = 10f64.powf(wanted.log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power);
    steps.into_iter().find(|s| *s >= 0.8 * wanted).unwrap_or(steps[3])
}

/// Labels of ticks, with the digits of their step.
pub(super) fn tick_labels(ticks: &[f64]) -> Vec<String> {
    let step = ticks.windows(2).map(|w| w[1] - w[0]).next().unwrap_or(1.0);
    let places = (-(step * (1.0 + 1e-9)).log10().floor()).clamp(0.0, 12.0) as usize;
    ticks.iter().map(|t| with_true_minus(&format!("{:.places$}", t + 0.0))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within() {
        let texts = |low, high, about| tick_labels(&round_ticks(low, high, about));
        assert_eq!(texts(0.0, 10.0, 5), ["0", "2", "4", "6", "8", "10"]);
        assert_eq!(texts(-0.31, 0.27, 5), ["\u{2212}0.3", "\u{2212}0.2", "\u{2212}0.1", "0.0", "0.1", "0.2"]);
        assert_eq!(texts(1e-4, 3.4e-4, 3), ["0.0001", "0.0002", "0.0003"]);
        assert_eq!(texts(994.0, 1012.0, 4), ["995", "1000", "1005", "1010"]);
        assert!(round_ticks(1.0, 1.0, 5).is_empty() && round_ticks(f64::NAN, 1.0, 5).is_empty());
        assert!(round_ticks(0.0, f64::INFINITY, 5).is_empty());
    }
}
