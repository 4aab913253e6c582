//! Units of an FMU as texts of columns.
//!
//! Scenarios convert by what a text means here, so a unit that the FMU defines otherwise gets a text that means nothing
//! here: no conversion follows from it, and `factor` has to be given.

use std::collections::BTreeSet;

use shared_types::describe::DefinedUnit;
use shared_types::units;

use super::line;
use crate::fmi::description::{BASE_UNITS, BaseUnit, ModelDescription, Unit};

/// Longest unit that is taken over.
const LONGEST: usize = 64;
/// End of the text of a unit that is another here.
const MARK: &str = " (FMU)";
/// Difference, as a part, between two factors that is rounding alone: tools write few digits.
const ROUNDING: f64 = 1e-5;
/// Place of rad among the exponents.
const RADIAN: usize = 7;

/// Units of a model that are others here, as `t` for a short ton.
pub(super) struct Units<'a> {
    others: BTreeSet<&'a str>,
}

impl<'a> Units<'a> {
    /// The units that a model defines.
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

    /// A unit as a column may have it.
    pub(super) fn text(&self, unit: &str) -> String {
        if self.others.contains(unit) {
            return plain(unit, LONGEST - MARK.len()) + MARK;
        }
        match plain(unit, LONGEST) {
            text if text.is_empty() => "1".into(),
            text => text,
        }
    }

    /// Definitions, as they are shown.
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

/// A unit as one line without the brackets that are around units elsewhere.
fn plain(unit: &str, most: usize) -> String {
    line(&unit.replace('[', "(").replace(']', ")"), most)
}

/// Checks whether a text means another unit here than this one.
fn is_other(text: &str, base: &BaseUnit) -> bool {
    let Ok(here) = units::Unit::parse(text) else {
        return false;
    };
    let is_near = |a: f64, b: f64| {
        let off = (a - b).abs();
        off <= ROUNDING * a.abs() || off <= ROUNDING * b.abs()
    };
    let is_same = |base: &BaseUnit| {
        let told = units::Unit::parse(&base_text(base)).ok();
        let conversion = told.and_then(|told| here.conversion_to(&told));
        conversion.is_some_and(|conversion| {
            is_near(conversion.factor, base.factor) && is_near(conversion.offset, base.offset)
        })
    };
    // Many tools leave rad out, which is 1 to them.
    let with = |radian| {
        let mut other = *base;
        other.exponents[RADIAN] = radian;
        other
    };
    let told = base.exponents[RADIAN];
    ![told, -2, -1, 0, 1, 2].map(with).iter().any(is_same)
}

/// Product of powers, for example `kg m2 s-2`.
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
    fn a_unit_that_is_another_here_is_found_and_rounding_is_none() {
        for (text, told) in [
            ("mm", base(&[(M, 1)], 1e-3, 0.0)),
            ("degC", base(&[(K, 1)], 1.0, 273.15)),
            ("degF", base(&[(K, 1)], 0.555_556, 255.37)),
            ("rpm", base(&[(S, -1)], 0.104_719_755, 0.0)),
            ("rad/s", base(&[(S, -1), (RADIAN, 1)], 1.0, 0.0)),
            ("deg", base(&[], 0.017_453_29, 0.0)),
            ("1", base(&[], 1.0, 0.0)),
            ("furlong", base(&[(M, 1)], 201.168, 0.0)),
        ] {
            assert!(!is_other(text, &told), "{text}");
        }
        for (text, told) in [
            ("t", base(&[(0, 1)], 907.184_74, 0.0)),
            ("C", base(&[(K, 1)], 1.0, 273.15)),
            ("degC", base(&[(K, 1)], 1.0, 0.0)),
            ("m", base(&[(M, 1)], 1e-3, 0.0)),
            ("h", base(&[(M, 2), (0, 1), (S, -1)], 6.626e-34, 0.0)),
        ] {
            assert!(is_other(text, &told), "{text}");
        }
    }

    #[test]
    fn its_text_says_whose_it_is() {
        let units = Units {
            others: ["t"].into(),
        };
        assert_eq!(units.text("t"), "t (FMU)");
        assert_eq!(units.text("kg"), "kg");
        assert_eq!(units.text(""), "1");
        assert!(units::Unit::parse("t (FMU)").is_err());
    }
}
