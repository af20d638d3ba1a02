//! Robust statistics of a list of numbers.

/// Ratio of the standard deviation of a normal distribution to its median absolute deviation (Rousseeuw and
/// Croux 1993);
/// derived: one over the quantile at 3/4 of the standard normal distribution, to four places.
pub const SIGMAS_PER_MAD: f64 = 1.4826;

/// Median absolute deviation of a normal distribution, in standard deviations.
/// derived: the quantile at 75 % of the standard normal distribution.
pub const MAD_IN_SIGMAS: f64 = 0.674_49;

/// Half width of a 95 % interval in standard deviations.
/// derived: the quantile at 97.5 % of the standard normal distribution.
pub const HALF_WIDTH_95: f64 = 1.959_964;

/// Standard deviations that one normal value of a hundred exceeds.
/// derived: the quantile at 99 % of the standard normal distribution.
const NORMAL_99: f64 = 2.326_348;

/// Standard deviations that one normal value of twenty exceeds.
/// derived: the quantile at 95 % of the standard normal distribution.
const NORMAL_95: f64 = 1.644_854;

/// Limits that the sum of 1, 2, ... squared standard normal numbers exceeds once in twenty times.
/// derived: quantiles of chi-square at 95 %.
pub const CHI_SQUARE_95: [f64; 6] = [3.84, 5.99, 7.81, 9.49, 11.07, 12.59];

/// Limits that the sum of 1, 2, ... squared standard normal numbers exceeds once in a thousand times.
/// derived: quantiles of chi-square at 99.9 %.
pub const CHI_SQUARE_999: [f64; 6] = [10.828, 13.815_51, 16.266, 18.467, 20.515, 22.46];

/// Limit that the sum of six squared standard normal numbers exceeds every other time.
/// derived: the median of chi-square.
pub const CHI_SQUARE_MEDIAN_6: f64 = 5.35;

/// Limit that the sum of `count` squared standard normal numbers exceeds once in a hundred times: the
/// quantile of chi-square at 99 %.
pub fn chi_square_99(count: f64) -> f64 {
    chi_square(count, NORMAL_99)
}

/// Limit that the sum of `count` squared standard normal numbers exceeds once in twenty times; for a count of
/// one it is 2.5 % less than in [`CHI_SQUARE_95`], from three on it is the same.
pub fn chi_square_95(count: f64) -> f64 {
    chi_square(count, NORMAL_95)
}

/// The quantile of chi-square that corresponds to a quantile of a normal distribution (Wilson and Hilferty
/// 1931).
fn chi_square(count: f64, normal: f64) -> f64 {
    let variance = 2.0 / (9.0 * count);
    count * (1.0 - variance + normal * variance.sqrt()).powi(3)
}

/// The middle value, the upper of two; `None` for an empty list.
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    // By selection in linear time; a full sort is not needed.
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chance_exceeds_the_quantile_once_in_a_hundred() {
        // Tables of chi-square, 1 % beyond each.
        for (count, quantile, most) in
            [(3.0, 11.345, 0.01), (8.0, 20.090, 2e-3), (50.0, 76.154, 2e-3), (200.0, 249.445, 2e-3)]
        {
            assert!(
                (chi_square_99(count) / quantile - 1.0).abs() < most,
                "{count}: {}",
                chi_square_99(count)
            );
        }
    }

    #[test]
    fn the_middle_value_is_the_upper_one_of_two() {
        assert_eq!(median(vec![3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(vec![4.0, 1.0, 2.0, 3.0]), Some(3.0));
        assert_eq!(median(Vec::new()), None);
    }
}
