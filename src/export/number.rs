//! Numbers as text: few digits, no minus zero, reproducible.

/// `value` with at most `places` decimals, without trailing zeros; never `-0`, never an exponent.
///
/// For lengths and angles, where noise below the last decimal has no meaning.
pub fn decimal(value: f64, places: usize) -> String {
    let text = format!("{value:.places$}");
    // Zeros are trimmed only after a point, not those of 100.
    let short = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    // A small negative number rounds to minus zero; its sign is noise.
    if short == "-0" { "0".to_owned() } else { short.to_owned() }
}

/// `value` with at most `digits` significant digits, with an exponent if this is shorter; never `-0`.
///
/// For masses and inertias, whose magnitude varies widely.
pub fn significant(value: f64, digits: usize) -> String {
    let rounded = round_significant(value, digits);
    if rounded == 0.0 {
        return "0".to_owned();
    }
    let plain = rounded.to_string();
    let exponent = format!("{rounded:e}");
    if exponent.len() < plain.len() { exponent } else { plain }
}

/// `value` rounded to `digits` significant digits; minus zero becomes zero. Infinities and NaN stay.
pub fn round_significant(value: f64, digits: usize) -> f64 {
    if !value.is_finite() {
        return value;
    }
    // Through text, because the double nearest to the decimal then prints with these digits. Scaling by a
    // power of ten does not guarantee this. Adding 0 removes the sign of minus zero.
    let text = format!("{value:.*e}", digits.saturating_sub(1));
    text.parse::<f64>().unwrap_or(value) + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn decimals_are_short_and_have_no_minus_zero() {
        for (value, places, text) in [
            (0.0, 3, "0"),
            (-0.0, 3, "0"),
            (-1e-9, 6, "0"),
            (1.5, 6, "1.5"),
            (-0.1234567, 4, "-0.1235"),
            (100.0, 0, "100"),
            (100.0, 2, "100"),
            (1.0 / 3.0, 12, "0.333333333333"),
        ] {
            assert_eq!(decimal(value, places), text);
        }
    }

    #[test]
    fn significant_digits_choose_the_shorter_form() {
        for (value, digits, text) in [
            (0.0, 6, "0"),
            (-0.0, 6, "0"),
            (1.23456789, 4, "1.235"),
            (1.23456789e-7, 4, "1.235e-7"),
            (12345.678, 6, "12345.7"),
            (-2.0, 9, "-2"),
            (1e20, 3, "1e20"),
        ] {
            assert_eq!(significant(value, digits), text);
        }
    }

    proptest! {
        #[test]
        fn text_reads_back_within_the_last_place(value in -1e3..1e3f64) {
            prop_assert!((decimal(value, 9).parse::<f64>().unwrap() - value).abs() <= 0.51e-9);
            let back = significant(value, 9).parse::<f64>().unwrap();
            prop_assert!((back - value).abs() <= 0.51e-8 * value.abs());
        }
    }
}
