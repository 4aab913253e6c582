//! Number in a scenario: name, unit, range, default; and formatting of numbers.
//!
//! Common form of the scenario's own keys and of the parameters, magnitudes and speeds that plants and laws describe,
//! so that all of them are checked and explained alike.

use shared_types::number::{exact as number, unit_shown};
use shared_types::table::Field;

/// Number with its unit and range.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Quantity<'a> {
    /// Key.
    pub name: &'a str,
    /// Unit as text; `1` and the empty text mean none.
    pub unit: &'a str,
    /// Smallest valid value.
    pub min: f64,
    /// Largest valid value.
    pub max: f64,
    /// `true` if only whole numbers are valid.
    pub whole: bool,
}

impl<'a> From<&'a Field> for Quantity<'a> {
    fn from(field: &'a Field) -> Self {
        Self {
            name: &field.name,
            unit: &field.unit,
            min: field.min,
            max: field.max,
            whole: field.is_whole || counts(field),
        }
    }
}

impl<'a> Quantity<'a> {
    /// Allows any finite number of a unit.
    pub(crate) const fn finite(unit: &'a str) -> Self {
        Self {
            name: "",
            unit,
            min: f64::MIN,
            max: f64::MAX,
            whole: false,
        }
    }

    /// Returns `true` if a value is a number in the range. Infinity is valid where the range includes it.
    pub(crate) fn admits(&self, value: f64) -> bool {
        (self.min..=self.max).contains(&value) && !(self.whole && value.fract() != 0.0)
    }

    /// Describes the expected value, for example `a number from 0 to 1000 in kg`.
    pub(crate) fn expected(&self) -> String {
        let range = self.range();
        let mut number = if self.whole {
            "a whole number"
        } else {
            "a number"
        }
        .to_owned();
        if !range.is_empty() {
            number = format!("{number} {range}");
        }
        match unit_shown(self.unit) {
            "" => number,
            unit => format!("{number} in {unit}"),
        }
    }

    /// Formats the range; empty if it is unlimited.
    pub(crate) fn range(&self) -> String {
        match (self.min > f64::MIN, self.max < f64::MAX) {
            (true, true) => format!("from {} to {}", number(self.min), number(self.max)),
            (true, false) => format!("of at least {}", number(self.min)),
            (false, true) => format!("of at most {}", number(self.max)),
            (false, false) => String::new(),
        }
    }
}

/// Returns `true` if a column counts steps or bits, according to its unit or the suffix of its name, so that only whole
/// numbers are meaningful.
fn counts(field: &Field) -> bool {
    const COUNTED: [&str; 2] = ["steps", "bits"];
    let last = field.name.rsplit(['_', '.']).next();
    COUNTED.contains(&field.unit.as_str()) || last.is_some_and(|last| COUNTED.contains(&last))
}

/// Formats a number as a TOML float, exact to the last bit.
pub(crate) fn toml_float(value: f64) -> String {
    let text = number(value);
    let is_integer = text.bytes().all(|c| c.is_ascii_digit() || c == b'-');
    if is_integer { text + ".0" } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_described_by_their_finite_ends() {
        let expected = |unit, min, max| {
            let any = Quantity::finite(unit);
            Quantity { min, max, ..any }.expected()
        };
        assert_eq!(
            expected("Hz", 1e-3, 1e6),
            "a number from 0.001 to 1e6 in Hz"
        );
        assert_eq!(expected("1", 0.0, f64::INFINITY), "a number of at least 0");
        assert_eq!(
            expected("m", f64::MIN, 5e-9),
            "a number of at most 5e-9 in m"
        );
        assert_eq!(expected("m", f64::MIN, f64::MAX), "a number in m");
    }

    #[test]
    fn only_whole_numbers_count_steps() {
        for (name, unit, whole) in [
            ("lag_steps", "1", true),
            ("steps", "steps", true),
            ("bits", "1", true),
            ("length", "steps", true),
            ("step", "rad", false),
            ("footsteps_m", "m", false),
        ] {
            let field = Field::signal(name, unit, "x");
            let quantity = Quantity::from(&field);
            assert_eq!(quantity.whole, whole, "{name}");
            assert_eq!(quantity.admits(2.5), !whole);
            assert!(quantity.admits(2.0));
        }
    }

    #[test]
    fn numbers_read_back_the_same() {
        for value in [
            0.1,
            -0.0,
            5e-7,
            1e21,
            28e6,
            1.0 / 3.0,
            f64::INFINITY,
            -f64::INFINITY,
        ] {
            for text in [number(value), toml_float(value)] {
                let parsed: f64 = text.parse().expect("a number");
                assert_eq!(parsed.to_bits(), value.to_bits(), "{text}");
            }
        }
    }
}
