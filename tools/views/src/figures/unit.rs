//! Units as figures print them: with powers of ten and raised digits.
//!
//! Never changes a value that a table or a message shows; only axes are scaled.

use shared_types::number::unit_shown;

use crate::prefix::ShownUnit;

/// Scale of an axis: the power of ten by which values are divided, and the text of the unit with it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ScaledUnit {
    pub(super) exponent: i32,
    /// Unit with prefix or power of ten; empty for a number of ordinary size.
    pub(super) text: String,
}

impl ScaledUnit {
    /// Chooses the scale for values up to this magnitude, as every view does.
    pub(super) fn of(unit: &str, largest: f64) -> Self {
        let shown = ShownUnit::of(unit, largest);
        let power = format!("1e{}", shown.power);
        let text = match shown.unit.strip_prefix(&power) {
            Some(rest) if shown.power != 0 => {
                let power = power_of_ten(shown.power);
                format!("{power} {}", printed(rest.trim()))
                    .trim_end()
                    .to_owned()
            }
            _ => printed(&shown.unit),
        };
        Self {
            exponent: shown.power,
            text,
        }
    }

    /// Returns the factor by which values are multiplied.
    pub(super) fn factor(&self) -> f64 {
        libm::pow(10.0, f64::from(-self.exponent))
    }
}

/// Appends a unit in brackets to a title, unless there is none.
pub(super) fn titled(title: &str, unit: &str) -> String {
    match (title, unit) {
        (title, "") => title.to_owned(),
        ("", unit) => format!("[{unit}]"),
        (title, unit) => format!("{title} [{unit}]"),
    }
}

/// Returns a unit as print has it: `m3/s/sqrt(Pa)` as `m³/s/√Pa`.
pub(super) fn printed(unit: &str) -> String {
    let mut text = String::new();
    let mut before = ' ';
    for character in unit_shown(unit).chars() {
        match character {
            digit if digit.is_ascii_digit() && before.is_alphabetic() => {
                text.push_str(&raised(&digit.to_string()));
            }
            other => text.push(other),
        }
        before = character;
    }
    while let Some((before, rest)) = text.split_once("sqrt(") {
        let Some((root, after)) = rest.split_once(')') else {
            break;
        };
        text = match root.contains([' ', '/']) {
            true => format!("{before}√({root}){after}"),
            false => format!("{before}√{root}{after}"),
        };
    }
    text.replace("deg", "°")
}

/// Formats a power of ten with a raised exponent.
pub(super) fn power_of_ten(exponent: i32) -> String {
    format!("10{}", raised(&exponent.to_string()))
}

fn raised(digits: &str) -> String {
    let raised = |character: char| match character {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        '0'..='9' => char::from_u32(0x2070 + (character as u32 - 0x30)).unwrap_or(character),
        other => other,
    };
    digits.chars().map(raised).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_has_a_prefix_only_where_its_numbers_would_be_long() {
        for (unit, largest, exponent, text) in [
            ("Pa", 2.8e7, 6, "MPa"),
            ("N", 5000.0, 0, "N"),
            ("N", 25_000.0, 3, "kN"),
            ("m", 1e6, 6, "Mm"),
            ("rad", 0.05, -3, "mrad"),
            ("rad", 0.002, -3, "mrad"),
            ("m3/s", 4e-5, -6, "10⁻⁶ m³/s"),
            ("m3/s/sqrt(Pa)", 5e-7, -9, "10⁻⁹ m³/s/√Pa"),
            ("1", 0.5, 0, ""),
            ("1", 3e14, 12, "10¹²"),
            ("s", 20.0, 0, "s"),
            ("rad/s2", 0.0, 0, "rad/s²"),
        ] {
            let expected = ScaledUnit {
                exponent,
                text: text.into(),
            };
            assert_eq!(ScaledUnit::of(unit, largest), expected, "{unit} {largest}");
        }
        assert_eq!(printed("V/sqrt(Hz)"), "V/√Hz");
    }

    #[test]
    fn a_title_without_a_unit_has_no_brackets() {
        assert_eq!(
            titled("Pressure in chamber 1", "MPa"),
            "Pressure in chamber 1 [MPa]"
        );
        assert_eq!(titled("Alarm", ""), "Alarm");
        assert_eq!(titled("", "N"), "[N]");
    }
}
