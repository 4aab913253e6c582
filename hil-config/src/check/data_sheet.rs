//! Numbers as data sheets write them: `"0.1 deg/h"`, `"70 ug/sqrt(Hz)"`, `"2 LSB"`, `"0.1 % of range"`.
//!
//! A plain number counts in the unit of the signal. Sources:
//!
//! - A unit with the root of a frequency is a one-sided amplitude density, as in data sheets and IEEE 1139.
//! - A unit divided by the root of a time, such as deg/sqrt(h), is the random walk coefficient N of IEEE 952, whose
//!   two-sided power density is N^2 (annex C); the one-sided amplitude density is sqrt(2) N.
//! - `g` in an acceleration is standard gravity, 9.80665 m/s2 (3rd CGPM, 1901), and not the gram.
//! - `LSB` is the step of the converter; `% of range` is a part of the distance between its ends (IEEE 1241,
//!   full-scale range).

use shared_types::number::{exact as number, unit_shown};
use shared_types::units::Unit;

use crate::document::{Node, Value};
use crate::keys::KeyKind;
use crate::problem::ProblemKind;
use crate::quantity::Quantity;
use crate::reader::{Reader, Section};

/// Standard gravity in m/s2.
const GRAVITY_MPS2: f64 = 9.806_65;

/// Units of an instrument's keys.
pub(super) struct Scales<'a> {
    /// Unit of the instrument's signal.
    pub(super) unit: &'a str,
    /// Ends of the instrument's range.
    pub(super) range: Option<(f64, f64)>,
    /// Step of the instrument's converter.
    pub(super) lsb: Option<f64>,
}

/// Reason why a text is not a quantity.
struct Unfit {
    message: String,
    help: Option<String>,
}

impl Unfit {
    fn new(message: String) -> Self {
        Self {
            message,
            help: None,
        }
    }
}

impl<'a> Scales<'a> {
    /// Creates the units of a signal before its range and step are known.
    pub(super) const fn new(unit: &'a str) -> Self {
        Self {
            unit,
            range: None,
            lsb: None,
        }
    }

    /// Reads the value of a key of kind `Quantity` that the section contains.
    pub(super) fn quantity(
        &self,
        reader: &mut Reader,
        section: &Section<'_>,
        name: &'static str,
    ) -> Option<f64> {
        let key = section.keys.iter().find(|key| key.name == name)?;
        let KeyKind::Quantity { unit, min, max } = key.kind else {
            return None;
        };
        let unit = self.own(unit);
        let quantity = Quantity {
            min,
            max,
            ..Quantity::finite(&unit)
        };
        let node = &section.table.get(name)?.node;
        self.read(reader, &section.path_of(name), node, &quantity, false)
    }

    /// Reads an end of the range.
    pub(super) fn end(&self, reader: &mut Reader, path: &str, node: &Node) -> Option<f64> {
        self.read(reader, path, node, &Quantity::finite(self.unit), true)
    }

    /// Returns the unit of a key, with the signal's unit in place of `target`.
    fn own(&self, unit: &str) -> String {
        let Some(rest) = unit.strip_prefix("target") else {
            return unit.into();
        };
        match (unit_shown(self.unit), rest) {
            ("", "") => "1".into(),
            ("", rest) => format!("1{rest}"),
            (own, rest) => format!("{own}{rest}"),
        }
    }

    fn read(
        &self,
        reader: &mut Reader,
        path: &str,
        node: &Node,
        quantity: &Quantity<'_>,
        is_level: bool,
    ) -> Option<f64> {
        let Value::Text(text) = &node.value else {
            return reader.quantity(path, node, quantity);
        };
        let value = self.value(text, quantity.unit, is_level);
        let mut expected = format!("{}, or text with a unit of it", quantity.expected());
        if !is_level && quantity.unit == self.own("target") {
            expected += ", `LSB` or `% of range`";
        }
        match value {
            Ok(value) if quantity.admits(value) => Some(value),
            Ok(value) => {
                let message = format!(
                    "`{path}` is `{text}`, {} {}, out of range",
                    number(value),
                    unit_shown(quantity.unit)
                );
                reader
                    .report(ProblemKind::OutOfRange, path, &node.place, message)
                    .expected(expected);
                None
            }
            Err(Unfit { message, help }) => {
                let message = format!("`{path}` is `{text}`: {message}");
                let problem = reader.report(ProblemKind::Mismatch, path, &node.place, message);
                problem.expected(expected);
                problem.help(help.unwrap_or_default());
                None
            }
        }
    }

    /// Reads the value of a text in a unit; a level, such as an end of the range, includes the offset of its unit.
    fn value(&self, text: &str, unit: &str, is_level: bool) -> Result<f64, Unfit> {
        let text = text.trim();
        let is_of_number = |c: char| c.is_ascii_digit() || matches!(c, '.' | '-' | '+' | '_');
        let mut end = text.find(|c| !is_of_number(c)).unwrap_or(text.len());
        if let Some(exponent) = text[end..].strip_prefix(['e', 'E']) {
            let sign = usize::from(exponent.starts_with(['-', '+']));
            let digits = exponent[sign..].bytes().take_while(u8::is_ascii_digit);
            end += match digits.count() {
                0 => 0,
                digits => 1 + sign + digits,
            };
        }
        let (value, symbol) = (text[..end].replace('_', ""), text[end..].trim());
        let value: f64 =
            (value.parse()).map_err(|_| Unfit::new("it does not begin with a number".into()))?;
        match symbol {
            "" => Ok(value),
            "LSB" if unit == self.own("target") => {
                let missing = "`LSB` needs `bits` and `range`, or `resolution`";
                let lsb = self.lsb.ok_or_else(|| Unfit::new(missing.into()))?;
                Ok(value * lsb)
            }
            "% of range" if unit == self.own("target") => {
                let (min, max) =
                    (self.range).ok_or_else(|| Unfit::new("`% of range` needs `range`".into()))?;
                Ok(value / 100.0 * (max - min))
            }
            symbol if symbol == unit => Ok(value),
            symbol => converted(value, symbol, unit, is_level),
        }
    }
}

/// Converts a value from one unit into another.
fn converted(value: f64, symbol: &str, unit: &str, is_level: bool) -> Result<f64, Unfit> {
    let unknown = |_| Unfit::new(format!("nothing converts to the signal's `{unit}`"));
    let target = Unit::parse(unit).map_err(unknown)?;
    let apply = |from: &Unit, value: f64| {
        let conversion = from.conversion_to(&target)?;
        let offset = if is_level { conversion.offset } else { 0.0 };
        Some(conversion.factor * value + offset)
    };
    let parsed = Unit::parse(symbol);
    if let Ok(from) = &parsed
        && let Some(value) = apply(from, value)
    {
        let is_walk = symbol.contains("/sqrt(") && !symbol.contains("Hz");
        let is_density = unit.ends_with("/sqrt(Hz)");
        return Ok(match is_walk && is_density {
            true => value * std::f64::consts::SQRT_2,
            false => value,
        });
    }
    if let Some((factor, rest)) = gravities(symbol)
        && let Ok(from) = Unit::parse(&rest)
        && let Some(value) = apply(&from, value * GRAVITY_MPS2)
    {
        return Ok(value / factor);
    }
    let mut unfit = match parsed {
        Ok(_) => Unfit::new(format!("`{symbol}` does not convert to {unit}")),
        Err(error) => Unfit::new(error.to_string()),
    };
    unfit.help = spelling(symbol).map(Into::into);
    if let Some(whole) = unit.strip_suffix("/s")
        && converted(value, symbol, whole, is_level).is_ok()
    {
        unfit.help = Some(format!(
            "a rate has a time too, as {symbol}/s or {symbol}/ms"
        ));
    }
    if unit.ends_with("/sqrt(Hz)") && symbol.contains("/sqrt(") {
        unfit.help = Some(format!(
            "a density of this signal is in {unit}; N of IEEE 952, such as deg/sqrt(h), applies to a rate, such as rad/s"
        ));
    }
    Err(unfit)
}

/// Returns how a frequent other spelling is written here.
fn spelling(symbol: &str) -> Option<&'static str> {
    let lower = symbol.to_ascii_lowercase();
    let steps = [
        "bit", "bits", "lsb", "lsbs", "count", "counts", "digit", "digits",
    ];
    if steps.contains(&lower.as_str()) {
        Some("steps of the converter are written `LSB`")
    } else if lower.starts_with('%') {
        Some("a part of the range is written `% of range`")
    } else if lower.contains("per ") {
        Some("a quotient is written with `/`, as A/ms")
    } else {
        None
    }
}

/// Splits a unit that begins with parts of standard gravity: the number of parts in one, and the unit with m/s2
/// instead.
fn gravities(symbol: &str) -> Option<(f64, String)> {
    let parts = [
        ("g", 1.0),
        ("mg", 1e3),
        ("ug", 1e6),
        ("µg", 1e6),
        ("ng", 1e9),
    ];
    let end = symbol.find(|c: char| !c.is_alphabetic());
    let (first, rest) = symbol.split_at(end.unwrap_or(symbol.len()));
    let (_, factor) = parts.into_iter().find(|(part, _)| *part == first)?;
    Some((factor, format!("(m/s2){rest}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(text: &str, signal: &str, form: &str) -> Option<f64> {
        let scales = Scales {
            unit: signal,
            range: Some((-2.0, 6.0)),
            lsb: Some(0.25),
        };
        scales.value(text, &scales.own(form), false).ok()
    }

    #[test]
    fn units_of_data_sheets_are_their_definitions() {
        let degree = std::f64::consts::PI / 180.0;
        let density = "target/sqrt(Hz)";
        for (text, signal, form, expected) in [
            ("0.1 deg/h", "rad/s", "target", 0.1 * degree / 3600.0),
            ("3", "rad", "target", 3.0),
            ("-2.5e-1 mrad", "rad", "target", -2.5e-4),
            ("2 LSB", "rad", "target", 0.5),
            ("0.1 % of range", "rad", "target", 0.008),
            ("0.01 deg/s/sqrt(Hz)", "rad/s", density, 0.01 * degree),
            // N in deg/sqrt(h) is N degree / 60 in rad/sqrt(s); sqrt(2) of it is one-sided.
            (
                "0.3 deg/sqrt(h)",
                "rad/s",
                density,
                2.0_f64.sqrt() * 0.3 * degree / 60.0,
            ),
            ("70 ug/sqrt(Hz)", "m/s2", density, 70e-6 * 9.80665),
            ("2 mg", "m/s2", "target", 2e-3 * 9.80665),
            (
                "0.1 m/s/sqrt(h)",
                "m/s2",
                density,
                2.0_f64.sqrt() * 0.1 / 60.0,
            ),
            ("200 mA/ms", "A", "target/s", 200.0),
            ("3 ms", "A", "s", 0.003),
            ("1 kHz", "A", "Hz", 1000.0),
            ("100.1 %", "A", "1", 1.001),
            ("2 g", "kg", "target", 2e-3),
            ("5 degC", "K", "target", 5.0),
            ("7 furlong", "furlong", "target", 7.0),
        ] {
            let value = value(text, signal, form).unwrap_or_else(|| panic!("{text}"));
            let error = (value - expected).abs();
            assert!(
                error <= 4e-16 * expected.abs(),
                "{text}: {value} {expected}"
            );
        }
    }

    #[test]
    fn units_of_another_dimension_are_refused() {
        for (text, signal, form) in [
            ("1 deg/sqrt(h)", "rad", "target/sqrt(Hz)"),
            ("1 deg", "rad/s", "target"),
            ("1 LSB", "rad", "target/sqrt(Hz)"),
            ("1 ug", "rad", "target"),
            ("deg", "rad", "target"),
            ("1e deg", "rad", "target"),
            ("1 deg", "furlong", "target"),
            ("", "rad", "target"),
        ] {
            assert_eq!(value(text, signal, form), None, "{text}");
        }
    }
}
