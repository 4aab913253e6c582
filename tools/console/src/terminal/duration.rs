//! Durations as typed by users: `2s`, `500ms`, `100us`, or a plain number.
//!
//! Used by the command line and for the parameters of faults. The result is the double nearest to the given value: the
//! unit shifts the decimal exponent, without a multiplication.

/// Units of time with their decimal exponents; units that end like another come first.
const UNITS: [(&str, i32); 4] = [("ms", -3), ("us", -6), ("ns", -9), ("s", 0)];

/// Parses a duration, in s.
///
/// # Errors
/// If the text is not a duration; the message shows valid forms.
pub fn seconds(text: &str) -> Result<f64, String> {
    let expected = || {
        format!("`{text}` is not a duration: write 2s, 500ms, 100us, or a plain number of seconds")
    };
    in_unit(text, "s")
        .filter(|value| *value >= 0.0)
        .ok_or_else(expected)
}

/// Parses a number and converts it to `unit`; the text may contain a unit of time only if `unit` is a unit of time.
#[must_use]
pub fn in_unit(text: &str, unit: &str) -> Option<f64> {
    let text = text.trim();
    let exponent_of = |unit| {
        UNITS
            .iter()
            .find(|known| known.0 == unit)
            .map(|known| known.1)
    };
    let typed =
        (UNITS.iter()).find_map(|(unit, exponent)| Some((text.strip_suffix(unit)?, exponent)));
    let (Some(target), Some((number, typed))) = (exponent_of(unit), typed) else {
        return text.parse().ok();
    };
    let number = number.trim_end();
    // Appending an exponent must not turn `1_e-3` or `infe-3` into numbers.
    number
        .parse::<f64>()
        .ok()
        .filter(|value| value.is_finite())?;
    let (digits, exponent) = match number.split_once(['e', 'E']) {
        Some((digits, exponent)) => (digits, exponent.parse().ok()?),
        None => (number, 0_i32),
    };
    let exponent = exponent.checked_add(typed - target)?;
    format!("{digits}e{exponent}").parse().ok()
}

/// Formats a time with three digits and a unit.
#[must_use]
pub fn shown_ns(ns: u64) -> String {
    let (value, unit) = match ns {
        0..1_000 => return format!("{ns} ns"),
        1_000..1_000_000 => (ns as f64 / 1e3, "us"),
        1_000_000..1_000_000_000 => (ns as f64 / 1e6, "ms"),
        _ => (ns as f64 / 1e9, "s"),
    };
    let decimals = match value {
        value if value < 9.995 => 2,
        value if value < 99.95 => 1,
        _ => 0,
    };
    format!("{value:.decimals$} {unit}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_duration_is_the_double_nearest_to_the_typed_value() {
        for (text, expected) in [
            ("2s", 2.0),
            ("500ms", 0.5),
            ("100us", 1e-4),
            ("7ns", 7e-9),
            ("0.3", 0.3),
            ("1e3us", 1e-3),
            ("1.5E-1 ms", 1.5e-4),
            ("0", 0.0),
        ] {
            assert_eq!(seconds(text), Ok(expected), "{text}");
        }
        for text in [
            "",
            "s",
            "2m",
            "-1s",
            "2ss",
            "1e99999999999s",
            "infs",
            "nan",
            "2 s 3",
        ] {
            assert!(seconds(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_unit_of_time_is_accepted_only_for_times() {
        assert_eq!(in_unit("2ms", "us"), Some(2000.0));
        assert_eq!(in_unit("200", "us"), Some(200.0));
        assert_eq!(in_unit("-3", "rad"), Some(-3.0));
        assert_eq!(in_unit("3s", "rad"), None);
        assert_eq!(in_unit("inf", "s"), Some(f64::INFINITY));
    }

    #[test]
    fn times_are_shown_with_three_digits() {
        for (ns, text) in [
            (0, "0 ns"),
            (999, "999 ns"),
            (1_000, "1.00 us"),
            (9_996, "10.0 us"),
            (43_210, "43.2 us"),
            (404_000, "404 us"),
            (24_820_000, "24.8 ms"),
            (3_000_000_000, "3.00 s"),
        ] {
            assert_eq!(shown_ns(ns), text);
        }
    }
}
