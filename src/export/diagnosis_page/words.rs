//! Numbers and names of a diagnosis as shown on a page.

use crate::page::with_true_minus;
use gap::judge::locate::Variable;
use model::escape_xml;

/// A name of the catalogue in words.
pub(super) fn escaped_words(name: &str) -> String {
    escape_xml(&name.replace('_', " "))
}

/// A unit with superscript powers; empty for a plain number.
pub(super) fn unit_text(unit: &str) -> String {
    if unit == "1" {
        return String::new();
    }
    escape_xml(&unit.replace("^2", "\u{b2}").replace("^3", "\u{b3}").replace(' ', "\u{a0}"))
}

/// Number of decimals for a number with an interval of this half width: two significant digits of the half
/// width if it begins with 1 to 3, else one; three digits of the number without an interval. Negative if
/// digits before the point carry no meaning.
pub(super) fn decimal_places(value: f64, half: f64) -> i32 {
    let digits = if half / 10f64.powf(half.log10().floor()) < 3.55 { 2 } else { 1 };
    match (half > 0.0 && half.is_finite(), value != 0.0 && value.is_finite()) {
        // At least one digit of the value: an interval may be wider than the value.
        (true, true) => digits_after_point(half, digits).max(digits_after_point(value, 1)),
        (true, false) => digits_after_point(half, digits),
        (false, true) => digits_after_point(value, 3).max(0),
        (false, false) => 2,
    }
}

/// Number of decimals that shows `x` with this many significant digits.
fn digits_after_point(x: f64, significant: i32) -> i32 {
    (significant - 1 - x.abs().log10().floor() as i32).clamp(-9, 12)
}

/// A number rounded to this many decimals; with an exponent if these are too many to read.
pub(super) fn fixed_text(value: f64, places: i32) -> String {
    if !value.is_finite() {
        return "\u{2013}".into();
    }
    if value == 0.0 && places > 6 {
        return "0".into();
    }
    let exponent = if value == 0.0 { 0 } else { value.abs().log10().floor() as i32 };
    if places > 6 && exponent < -4 {
        let digits = (places + exponent).max(0) as usize;
        let text = format!("{value:.digits$e}");
        let (mantissa, power) = text.split_once('e').unwrap_or((&text, "0"));
        return with_true_minus(&format!("{mantissa}\u{b7}10<sup>{power}</sup>"));
    }
    let last = 10f64.powi(-places.min(0));
    // With decimals, formatting rounds exactly.
    let value = if places < 0 { (value / last).round() * last } else { value };
    let text = format!("{value:.0$}", places.max(0) as usize);
    // The sign of a rounded zero is noise.
    let is_zero = text.chars().all(|c| matches!(c, '-' | '0' | '.'));
    with_true_minus(if is_zero { text.trim_start_matches('-') } else { &text })
}

/// A position residual with three digits, in thousandths of the unit.
pub(super) fn residual_text(value: f64, unit: &str) -> String {
    if !value.is_finite() {
        return "beyond bounds".into();
    }
    let (value, unit) = match unit {
        "rad" => (1e3 * value, "mrad".to_owned()),
        "m" => (1e3 * value, "mm".to_owned()),
        other => (value, unit_text(other)),
    };
    format!("{}\u{a0}<span class=\"unit\">{unit}</span>", fixed_text(value, decimal_places(value, 0.0)))
}

/// A position; angles also in degrees.
pub(super) fn position_text(value: f64, turns: bool) -> String {
    if turns {
        format!("{}\u{a0}rad ({}\u{b0})", fixed_text(value, 2), fixed_text(value.to_degrees(), 0))
    } else {
        format!("{}\u{a0}mm", fixed_text(1e3 * value, 1))
    }
}

/// A number with its unit, if any.
pub(super) fn with_unit(number: &str, unit: &str) -> String {
    let unit = unit_text(unit);
    if unit.is_empty() { number.to_owned() } else { format!("{number}\u{a0}{unit}") }
}

/// A variable in words.
pub(super) fn variable_name(variable: Variable) -> &'static str {
    if variable == Variable::Effort { "measured effort" } else { variable.name() }
}

/// The unit of the effort of a joint.
pub(super) fn effort_unit(turns: bool) -> &'static str {
    if turns { "N\u{a0}m" } else { "N" }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_digits_of_their_intervals() {
        for (value, half, text) in [
            (0.2304, 0.004, "0.230"),
            (0.2304, 0.0021, "0.2304"),
            (0.2304, 0.04, "0.23"),
            (12.0, 3.0, "12.0"),
            (26_948.0, 13_155.0, "27000"),
            (26_948.0, 555.0, "26900"),
            (-0.2, 0.0, "\u{2212}0.200"),
            (-1e-9, 0.0, "\u{2212}1.00\u{b7}10<sup>\u{2212}9</sup>"),
            (0.0, 0.0, "0.00"),
        ] {
            assert_eq!(fixed_text(value, decimal_places(value, half)), text, "{value} {half}");
        }
        assert_eq!(fixed_text(2.31e-7, 9), "2.31\u{b7}10<sup>\u{2212}7</sup>");
    }

    #[test]
    fn units_and_names_are_read_not_run() {
        assert_eq!(unit_text("N m s^2/rad^2"), "N\u{a0}m\u{a0}s\u{b2}/rad\u{b2}");
        assert_eq!(unit_text("1"), "");
        assert_eq!(escaped_words("end_stop<b>"), "end stop&lt;b&gt;");
    }
}
