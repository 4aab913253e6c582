//! Units with SI prefixes, in which plots show values: `MPa` for pressures of 2.8e7 Pa.
//!
//! Used for headings, axes and legends of every view; `page.js` has the same rule for the pages. Never changes a value
//! that is recorded, judged or exported.

use serde::Serialize;
use shared_types::number::unit_shown;

/// Symbols that take a prefix, and `true` for those that take prefixes above one too: nobody says kilosecond.
const SYMBOLS: [(&str, bool); 13] = [
    ("Pa", true),
    ("N", true),
    ("A", true),
    ("V", true),
    ("W", true),
    ("J", true),
    ("Hz", true),
    ("Ohm", true),
    ("m", true),
    ("F", false),
    ("H", false),
    ("rad", false),
    ("s", false),
];
/// Prefixes from 1e-12 to 1e12.
const PREFIXES: [&str; 9] = ["p", "n", "µ", "m", "", "k", "M", "G", "T"];

/// Unit in which a plot shows its values.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ShownUnit {
    /// Power of ten by which values are divided.
    pub power: i32,
    /// Unit with its prefix; empty for a plain number.
    pub unit: String,
}

impl ShownUnit {
    /// Returns the unit for values up to a magnitude.
    ///
    /// From 10,000 on and below 0.1 the prefix that leaves one to three digits before the point; for a unit without
    /// prefixes a power of ten, from a million on and below 0.001.
    #[must_use]
    pub fn of(unit: &str, largest: f64) -> Self {
        let plain = Self {
            power: 0,
            unit: unit_shown(unit).to_owned(),
        };
        // The measured times of a loop have units of their own.
        if unit == "ns" || unit == "steps" || !largest.is_finite() || largest <= 0.0 {
            return plain;
        }
        let power = 3 * (libm::log10(largest) / 3.0 + 1e-12).floor() as i32;
        let symbol = SYMBOLS.iter().find(|(symbol, _)| {
            let rest = unit.strip_prefix(symbol);
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with([' ', '/']))
        });
        let is_usual = match symbol {
            Some((_, true)) => (0.1..1e4).contains(&largest),
            Some((_, false)) => largest >= 0.1,
            None => (1e-3..1e6).contains(&largest),
        };
        if is_usual || power == 0 {
            return plain;
        }
        let place = symbol.and(usize::try_from(power / 3 + 4).ok());
        let unit = match place.and_then(|place| PREFIXES.get(place)) {
            Some(prefix) => format!("{prefix}{unit}"),
            None => format!("1e{power} {}", unit_shown(unit)).trim().to_owned(),
        };
        Self { power, unit }
    }

    /// Returns the unit in brackets behind a space; empty for a plain number.
    #[must_use]
    pub fn bracketed(&self) -> String {
        match &*self.unit {
            "" => String::new(),
            unit => format!(" [{unit}]"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_prefix_leaves_one_to_three_digits_before_the_point() {
        for (unit, largest, power, expected) in [
            ("Pa", 28e6, 6, "MPa"),
            ("Pa", 1e6, 6, "MPa"),
            ("Pa", 9_999.0, 0, "Pa"),
            ("Pa", 999e3, 3, "kPa"),
            ("N", 5023.0, 0, "N"),
            ("N", 0.0, 0, "N"),
            ("A", 0.28, 0, "A"),
            ("A", 0.028, -3, "mA"),
            ("rad", 6.6e-4, -6, "µrad"),
            ("rad", 1e6, 0, "rad"),
            ("s", 86_400.0, 0, "s"),
            ("N m", 12e3, 3, "kN m"),
            ("N/s2", 4.8e10, 9, "GN/s2"),
            ("m", 0.01, -3, "mm"),
            // A prefix of a square or a cube would count twice or thrice.
            ("m3/s", 0.0015, 0, "m3/s"),
            ("m3/s/sqrt(Pa)", 5e-7, -9, "1e-9 m3/s/sqrt(Pa)"),
            ("mol", 1e-4, -6, "1e-6 mol"),
            ("1", 1e18, 18, "1e18"),
            ("1", 0.5, 0, ""),
            ("ns", 1e7, 0, "ns"),
            ("Pa", 1e15, 15, "1e15 Pa"),
            ("Pa", f64::NAN, 0, "Pa"),
        ] {
            let shown = ShownUnit::of(unit, largest);
            let result = (shown.power, &*shown.unit);
            assert_eq!(result, (power, expected), "{largest} {unit}");
        }
    }
}
