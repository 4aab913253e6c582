//! Units of an FMU as texts of columns.
//!
//! Scenarios convert by the meaning that a unit text has here. A unit that the FMU defines differently gets a text
//! without a meaning here, so that it does not convert and `factor` must be given.

use std::collections::BTreeSet;

use shared_types::describe::DefinedUnit;
use shared_types::units;

use super::line;
use crate::fmi::description::{BASE_UNITS, BaseUnit, ModelDescription, Unit};

/// Maximum length of a unit.
const LONGEST: usize = 64;
/// Suffix of a unit whose meaning differs here.
const MARK: &str = " (FMU)";
/// Relative difference of two factors that counts as rounding, because tools write few digits.
const ROUNDING: f64 = 1e-5;
/// Index of rad among the exponents.
const RADIAN: usize = 7;

/// Units of a model with another meaning here, such as `t` for a short ton.
pub(super) struct Units<'a> {
    others: BTreeSet<&'a str>,
}

impl<'a> Units<'a> {
    /// Collects the units that a model defines.
    pub(super) fn of(model: &'a ModelDescription) -> Self {
        let is_other = |unit: &&Unit| {
            let text = plain(&unit.name, LONGEST);
            unit.base.is_some_and(|base| is_other(&text, &base))
        };
        let others = model.units.iter().filter(is_other);
        Self {
            others: others.map(|unit| unit.name.as_str()).collect(),
        }
    }

    /// Returns a unit as the text of a column.
    pub(super) fn text(&self, unit: &str) -> String {
        if self.others.contains(unit) {
            return plain(unit, LONGEST - MARK.len()) + MARK;
        }
        match plain(unit, LONGEST) {
            text if text.is_empty() => "1".into(),
            text => text,
        }
    }

    /// Returns the definitions for display.
    pub(super) fn defined(&self, model: &ModelDescription) -> Vec<DefinedUnit> {
        let defined = |unit: &Unit| {
            let base = unit.base?;
            Some(DefinedUnit {
                name: self.text(&unit.name),
                base: base_text(&base),
                factor: base.factor,
                offset: base.offset,
            })
        };
        model.units.iter().filter_map(defined).collect()
    }
}

/// Converts a unit to one line, without the brackets that enclose units elsewhere.
fn plain(unit: &str, most: usize) -> String {
    line(&unit.replace('[', "(").replace(']', ")"), most)
}

/// Returns `true` if a text has another meaning here than this unit.
fn is_other(text: &str, base: &BaseUnit) -> bool {
    let Ok(meaning) = units::Unit::parse(text) else {
        return false;
    };
    let is_near = |a: f64, b: f64| {
        let off = (a - b).abs();
        off <= ROUNDING * a.abs() || off <= ROUNDING * b.abs()
    };
    let is_same = |base: &BaseUnit| {
        let base_unit = units::Unit::parse(&base_text(base)).ok();
        let conversion = base_unit.and_then(|base_unit| meaning.conversion_to(&base_unit));
        conversion.is_some_and(|conversion| {
            is_near(conversion.factor, base.factor) && is_near(conversion.offset, base.offset)
        })
    };
    // Many tools omit rad, which they treat as 1.
    let with = |radian| {
        let mut other = *base;
        other.exponents[RADIAN] = radian;
        other
    };
    let base_unit = base.exponents[RADIAN];
    ![base_unit, -2, -1, 0, 1, 2].map(with).iter().any(is_same)
}

/// Formats a product of powers, for example `kg m2 s-2`.
fn base_text(base: &BaseUnit) -> String {
    let powers = BASE_UNITS.iter().zip(base.exponents);
    let powers = powers.filter(|(_, exponent)| *exponent != 0);
    let powers = powers.map(|(name, exponent)| match exponent {
        1 => (*name).to_owned(),
        exponent => format!("{name}{exponent}"),
    });
    let text = powers.collect::<Vec<_>>().join(" ");
    match text.is_empty() {
        true => "1".into(),
        false => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const M: usize = 1;
    const S: usize = 2;
    const K: usize = 4;

    fn base(exponents: &[(usize, i32)], factor: f64, offset: f64) -> BaseUnit {
        let mut all = [0; 8];
        for (place, exponent) in exponents {
            all[*place] = *exponent;
        }
        BaseUnit {
            exponents: all,
            factor,
            offset,
        }
    }

    #[test]
    fn units_with_another_meaning_are_detected_despite_rounding() {
        for (text, base) in [
            ("mm", base(&[(M, 1)], 1e-3, 0.0)),
            ("degC", base(&[(K, 1)], 1.0, 273.15)),
            ("degF", base(&[(K, 1)], 0.555_556, 255.37)),
            ("rpm", base(&[(S, -1)], 0.104_719_755, 0.0)),
            ("rad/s", base(&[(S, -1), (RADIAN, 1)], 1.0, 0.0)),
            ("deg", base(&[], 0.017_453_29, 0.0)),
            ("1", base(&[], 1.0, 0.0)),
            ("furlong", base(&[(M, 1)], 201.168, 0.0)),
        ] {
            assert!(!is_other(text, &base), "{text}");
        }
        for (text, base) in [
            ("t", base(&[(0, 1)], 907.184_74, 0.0)),
            ("C", base(&[(K, 1)], 1.0, 273.15)),
            ("degC", base(&[(K, 1)], 1.0, 0.0)),
            ("m", base(&[(M, 1)], 1e-3, 0.0)),
            ("h", base(&[(M, 2), (0, 1), (S, -1)], 6.626e-34, 0.0)),
        ] {
            assert!(is_other(text, &base), "{text}");
        }
    }

    #[test]
    fn the_text_of_such_a_unit_is_marked() {
        let units = Units {
            others: ["t"].into(),
        };
        assert_eq!(units.text("t"), "t (FMU)");
        assert_eq!(units.text("kg"), "kg");
        assert_eq!(units.text(""), "1");
        assert!(units::Unit::parse("t (FMU)").is_err());
    }
}
