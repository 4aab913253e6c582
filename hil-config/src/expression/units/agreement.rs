//! Common unit of two values, and the refusal of incompatible ones.

use shared_types::units;

use super::{Mixed, Source, Unit};
use crate::expression::quantity::Quantity;

/// Refuses a number with a unit combined with a value that a factor may have converted: the number counts in SI units,
/// and would be wrong by that factor.
pub(super) fn refuse_converted(a: &Unit<'_>, b: &Unit<'_>) -> Result<(), Mixed> {
    let (quantity, source, has_unit, is_first) = match (a, b) {
        (
            Unit::Known {
                source: Source::Quantity(quantity),
                ..
            },
            Unit::Converted { source },
        ) => (quantity, source, false, true),
        (
            Unit::Converted { source },
            Unit::Known {
                source: Source::Quantity(quantity),
                ..
            },
        ) => (quantity, source, false, false),
        (
            Unit::Known {
                source: Source::Quantity(quantity),
                symbol,
                ..
            },
            Unit::Known {
                source,
                is_scaled: true,
                symbol: others,
                ..
            },
        ) if may_convert(symbol, others) => (quantity, source, true, true),
        (
            Unit::Known {
                source,
                is_scaled: true,
                symbol,
                ..
            },
            Unit::Known {
                source: Source::Quantity(quantity),
                symbol: others,
                ..
            },
        ) if may_convert(symbol, others) => (quantity, source, true, false),
        _ => return Ok(()),
    };
    if quantity.unit.is_plain() {
        return Ok(());
    }
    let (number, unit, name) = (&quantity.text, quantity.unit.coherent(), source.text());
    let message = if has_unit {
        format!(
            "`{number}` is taken in {unit}, but a number scales `{name}`, perhaps to convert the signal to another unit; scale `{number}` instead, write a plain number, or define a derived signal with a `unit`"
        )
    } else {
        format!(
            "`{number}` is taken in {unit}, but the derived signal `{name}` has no `unit` and is scaled by a number, perhaps to convert it to another unit; give the signal a `unit`, or write a plain number in that unit"
        )
    };
    let span = quantity.span.clone();
    let other = source.span().unwrap_or_else(|| span.clone());
    let (first, second) = if is_first {
        (span, other)
    } else {
        (other, span)
    };
    Err(Mixed {
        message,
        first,
        second,
    })
}

/// Common unit of two values.
pub(super) enum Agreement {
    /// Unit of the first value.
    First,
    /// Unit of the second value.
    Second,
    /// No known unit.
    None,
}

/// Returns the common unit of two values with known units. Signals agree if their units have the same text; a number
/// with a unit agrees with every value of its dimension in the coherent unit. If a number scales a signal, only the
/// dimension counts.
pub(super) fn agreement(
    (symbol, first): (&str, Source<'_>),
    (others, second): (&str, Source<'_>),
    is_scaled: bool,
    joined: &str,
) -> Result<Agreement, Mixed> {
    let fits = match (first, second) {
        _ if is_scaled && may_convert(symbol, others) => Ok(()),
        (Source::Quantity(quantity), other) => fitting(quantity, others, &other),
        (other, Source::Quantity(quantity)) => fitting(quantity, symbol, &other),
        _ if symbol == others => Ok(()),
        (Source::Integral, _) | (_, Source::Integral) => return Ok(Agreement::None),
        (Source::Signal(_), Source::Signal(name)) => Err(format!(
            "if this is intended, write a factor, as in `1 * {}`",
            name.path
        )),
    };
    match (fits, first, second) {
        // A signal keeps the unit of its own description.
        (Ok(()), Source::Quantity(_) | Source::Integral, Source::Signal(_)) => {
            Ok(Agreement::Second)
        }
        (Ok(()), ..) => Ok(Agreement::First),
        (Err(advice), ..) => {
            let symbol_of = |symbol: &str, source: &Source<'_>| match source {
                Source::Quantity(quantity) => quantity.symbol.clone(),
                _ => symbol.to_owned(),
            };
            let place = first.span().or(second.span()).unwrap_or_default();
            Err(Mixed {
                message: format!(
                    "`{}` is in {} and `{}` in {}, which cannot be {joined}; {advice}",
                    first.text(),
                    symbol_of(symbol, &first),
                    second.text(),
                    symbol_of(others, &second)
                ),
                first: first.span().unwrap_or_else(|| place.clone()),
                second: second.span().unwrap_or(place),
            })
        }
    }
}

/// Returns `true` unless two units are known to have different dimensions.
pub(super) fn may_convert(symbol: &str, others: &str) -> bool {
    match (units::Unit::parse(symbol), units::Unit::parse(others)) {
        (Ok(unit), Ok(other)) => unit.conversion_to(&other).is_some(),
        _ => true,
    }
}

/// Checks that a number with a unit is compatible with a value in another unit; the error is advice for the user.
fn fitting(quantity: &Quantity, symbol: &str, other: &Source<'_>) -> Result<(), String> {
    if let Source::Quantity(other) = other {
        return match quantity.unit.conversion_to(&other.unit) {
            Some(_) => Ok(()),
            None => Err("write both in units of one dimension".into()),
        };
    }
    let Ok(unit) = units::Unit::parse(symbol) else {
        return Err("write a plain number, which fits every unit".into());
    };
    match quantity.unit.conversion_to(&unit) {
        Some(_) if unit.is_coherent() => Ok(()),
        Some(conversion) if conversion.offset != 0.0 => Err(format!(
            "a number with a unit is converted to {}, so write a plain number in {symbol}: `{:?}` for a temperature, `{:?}` for a difference",
            quantity.unit.coherent(),
            conversion.apply(quantity.written),
            conversion.factor * quantity.written
        )),
        Some(conversion) => Err(format!(
            "a number with a unit is converted to {}, so write a plain number in {symbol}: `{:?}`",
            quantity.unit.coherent(),
            conversion.apply(quantity.written)
        )),
        None => Err("a plain number fits every unit".into()),
    }
}
