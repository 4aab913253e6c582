//! Numbers in human-readable form, with their units.
//!
//! Every message, table, report and reference page formats its numbers here: with [`exact`] where a user's number is
//! repeated or must be copied, with [`short`] for display. Measured durations, which range from ns to s, have units of
//! their own.

/// Formats a number exactly, to the last bit: `0.1`, `80`, `2.8e7`, `inf`, `nan`.
#[must_use]
pub fn exact(value: f64) -> String {
    if value.is_nan() {
        return "nan".into();
    }
    // `Debug` prints the shortest text that reads back the same, but many zeros before an exponent.
    let text = format!("{value:?}");
    let exponent = format!("{value:e}");
    if value.abs() >= 1e6 && exponent.len() < text.len() {
        return exponent;
    }
    text.strip_suffix(".0").map_or(text.clone(), Into::into)
}

/// Formats a number with five significant digits and no trailing zeros, with an exponent below 0.001 and from a million
/// on; between 100,000 and a million all digits before the point are kept.
#[must_use]
pub fn short(value: f64) -> String {
    let text = if (1e5..1e6).contains(&value.abs()) {
        format!("{value:.0}")
    } else {
        format!("{value:.4e}")
    };
    // No negative zero.
    let rounded = text.parse().map_or(value, |rounded: f64| rounded + 0.0);
    match rounded.abs() {
        size if size > 0.0 && size < 1e-3 => format!("{rounded:e}"),
        _ => exact(rounded),
    }
}

/// Formats a count, as in `1 record` or `2 records`; `thing` is a noun whose plural ends in s.
#[must_use]
pub fn counted(count: u64, thing: &str) -> String {
    let s = if count == 1 { "" } else { "s" };
    format!("{count} {thing}{s}")
}

/// Formats a number as [`exact`] does, followed by its unit, unless that is `1` or empty.
#[must_use]
pub fn exact_in(value: f64, unit: &str) -> String {
    with_unit(exact(value), unit)
}

/// Formats a number as [`short`] does, followed by its unit, unless that is `1` or empty.
#[must_use]
pub fn short_in(value: f64, unit: &str) -> String {
    with_unit(short(value), unit)
}

fn with_unit(number: String, unit: &str) -> String {
    match unit_shown(unit) {
        "" => number,
        unit => format!("{number} {unit}"),
    }
}

/// Returns a unit as displayed after a number: empty for `1`.
#[must_use]
pub fn unit_shown(unit: &str) -> &str {
    if unit == "1" { "" } else { unit }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_numbers_read_back_the_same() {
        for value in [
            0.1,
            -0.0,
            5e-7,
            1e21,
            28e6,
            1e30,
            123_456_789.0,
            1.0 / 3.0,
            f64::MAX,
            f64::INFINITY,
            -f64::INFINITY,
        ] {
            let text = exact(value);
            let parsed: f64 = text.parse().expect("a number");
            assert_eq!(parsed.to_bits(), value.to_bits(), "{text}");
            assert!(text.len() <= 24, "{text}");
        }
    }

    #[test]
    fn numbers_are_written_without_needless_digits() {
        for (value, expected, looked_at) in [
            (80.0, "80", "80"),
            (0.0, "0", "0"),
            (1e30, "1e30", "1e30"),
            (28e6, "2.8e7", "2.8e7"),
            (97.3872, "97.3872", "97.387"),
            (0.048_417_123, "0.048417123", "0.048417"),
            (25_401.13, "25401.13", "25401"),
            (254_011.3, "254011.3", "254011"),
            (999_999.7, "999999.7", "1e6"),
            (2.11657e-5, "2.11657e-5", "2.1166e-5"),
            (0.000_123_456_7, "0.0001234567", "1.2346e-4"),
            (0.001, "0.001", "0.001"),
            (-1.5e9, "-1.5e9", "-1.5e9"),
            (f64::NAN, "nan", "nan"),
            (f64::INFINITY, "inf", "inf"),
        ] {
            assert_eq!((&*exact(value), &*short(value)), (expected, looked_at));
        }
        assert_eq!(short(-0.0), "0");
    }

    #[test]
    fn a_dimensionless_number_has_no_unit() {
        assert_eq!(exact_in(80.0, "N/m"), "80 N/m");
        assert_eq!(short_in(0.048_417, "1"), "0.048417");
        assert_eq!(short_in(5.0, ""), "5");
    }
}
