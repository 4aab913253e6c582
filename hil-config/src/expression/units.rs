//! Units of expressions, as far as known.

mod agreement;

use std::borrow::Cow;
use std::ops::Range;

use shared_types::units;

use super::program::{Binary, Op, Unary};
use super::quantity::Quantity;
use super::{Columns, Expression, ExpressionError, Name, Reduced, ReductionKind};
use agreement::{Agreement, agreement, may_convert, refuse_converted};

/// Unit of a value, as far as known.
#[derive(Clone, Debug)]
pub(crate) enum Unit<'a> {
    /// Plain number, compatible with every unit.
    Number {
        /// `true` for a literal 1, which as a factor removes the unit on purpose.
        is_one: bool,
    },
    /// Value that may be in another unit than SI's, for example a derived signal without a unit that a factor scales.
    /// Compatible with everything except a number with a unit.
    Converted {
        /// Part of the expression to which a factor or another unit applies.
        source: Source<'a>,
    },
    /// Unknown: a product or quotient of two quantities, a truth value, or a signal without a unit.
    Unknown,
    /// Known unit.
    Known {
        symbol: Cow<'a, str>,
        /// First part of the expression with this unit.
        source: Source<'a>,
        /// `true` if the value is in this unit: neither scaled by a number nor added to a value of unknown unit.
        is_whole: bool,
        /// `true` if a possible conversion factor scales a signal: only the dimension is known.
        is_scaled: bool,
    },
}

/// Number that multiplies or divides a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scale {
    /// Factor `1`, which removes the unit.
    One,
    /// Number that may be a conversion, such as 1000 from m to mm.
    Number,
    /// Dimensionless quantity, such as 2%, which is no conversion.
    Part,
}

impl Scale {
    const fn by_number(is_one: bool) -> Self {
        if is_one { Self::One } else { Self::Number }
    }
}

/// Part of an expression that determines a unit.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Source<'a> {
    /// A signal.
    Signal(&'a Name),
    /// Number with a unit.
    Quantity(&'a Quantity),
    /// An integral: its unit is displayed, but not compared with the unit of signals, because J and W s are equal.
    Integral,
}

/// Two incompatible known units, with the places of the parts that have them, in bytes of their expressions.
pub(crate) struct Mixed {
    pub(crate) message: String,
    pub(crate) first: Range<usize>,
    pub(crate) second: Range<usize>,
}

impl Source<'_> {
    /// Returns the place in its expression; `None` for an integral.
    fn span(&self) -> Option<Range<usize>> {
        match self {
            Self::Signal(name) => Some(name.span.clone()),
            Self::Quantity(quantity) => Some(quantity.span.clone()),
            Self::Integral => None,
        }
    }

    /// Returns the part as text.
    fn text(&self) -> String {
        match self {
            Self::Signal(name) => name.path.clone(),
            Self::Quantity(quantity) => quantity.text.clone(),
            Self::Integral => "integral(..)".into(),
        }
    }
}

impl<'a> Unit<'a> {
    /// Creates the unit of a number with a unit: the coherent unit, in which the value counts.
    fn of_quantity(quantity: &'a Quantity) -> Self {
        let symbol = match quantity.unit.is_coherent() {
            true => quantity.symbol.as_str().into(),
            false => quantity.unit.coherent().into(),
        };
        Self::Known {
            symbol,
            source: Source::Quantity(quantity),
            is_whole: true,
            is_scaled: false,
        }
    }

    /// Returns the unit, if it applies to the whole value.
    pub(crate) fn symbol(&self) -> Option<&str> {
        match self {
            Self::Known {
                symbol,
                is_whole: true,
                ..
            } => Some(symbol),
            _ => None,
        }
    }

    /// Returns the common unit of two values that are `joined`, as in "added".
    ///
    /// # Errors
    /// If both units are known and differ.
    pub(crate) fn with(self, other: Self, joined: &str) -> Result<Self, Mixed> {
        refuse_converted(&self, &other)?;
        let (a, b) = match (self, other) {
            (Self::Number { .. }, unit) | (unit, Self::Number { .. }) => return Ok(unit),
            (a, Self::Unknown) => (Self::Unknown, a),
            (a, b @ Self::Converted { .. }) => (b, a),
            (a, b) => (a, b),
        };
        match (a, b) {
            (converted @ Self::Converted { .. }, _) => Ok(converted),
            (
                Self::Unknown,
                Self::Known {
                    symbol,
                    source,
                    is_scaled,
                    ..
                },
            ) => Ok(Self::Known {
                symbol,
                source,
                is_whole: false,
                is_scaled,
            }),
            (
                Self::Known {
                    symbol,
                    source,
                    is_whole,
                    is_scaled,
                },
                Self::Known {
                    symbol: others,
                    source: second,
                    is_whole: is_other_whole,
                    is_scaled: is_other_scaled,
                },
            ) => {
                let is_whole = is_whole && is_other_whole;
                let is_second_scaled = is_other_scaled && !is_scaled;
                let is_scaled = is_scaled || is_other_scaled;
                let known = |symbol, source| Self::Known {
                    symbol,
                    source,
                    is_whole,
                    is_scaled,
                };
                let (a, b) = ((&*symbol, source), (&*others, second));
                match agreement(a, b, is_scaled, joined)? {
                    // Named in an error: the part that a number scales.
                    Agreement::First if is_second_scaled => Ok(known(others, second)),
                    Agreement::First => Ok(known(symbol, source)),
                    Agreement::Second => Ok(known(others, second)),
                    Agreement::None => Ok(Self::Unknown),
                }
            }
            _ => Ok(Self::Unknown),
        }
    }

    /// Returns the unit of a product: the unit of one factor if the other is a plain number.
    fn times(self, other: Self) -> Result<Self, Mixed> {
        match (self, other) {
            (Self::Number { is_one }, unit) | (unit, Self::Number { is_one }) => {
                Ok(unit.scaled(Scale::by_number(is_one)))
            }
            (a, b) => match (a.scale(), b.scale()) {
                (_, Some(scale)) => Ok(a.scaled(scale)),
                (Some(scale), None) => Ok(b.scaled(scale)),
                (None, None) => a.of_two(&b, "multiplied"),
            },
        }
    }

    /// Returns the unit of a quotient: the unit of the dividend if the divisor is a plain number.
    fn per(self, divisor: &Self) -> Result<Self, Mixed> {
        match divisor.scale() {
            Some(scale) => Ok(self.scaled(scale)),
            None => self.of_two(divisor, "divided"),
        }
    }

    /// Returns the unit of a product or quotient of two values, neither of which is a plain number.
    ///
    /// # Errors
    /// If a number with a unit is combined with a value that is not in SI units.
    fn of_two(&self, other: &Self, joined: &str) -> Result<Self, Mixed> {
        refuse_converted(self, other)?;
        for (one, other) in [(self, other), (other, self)] {
            let Self::Known { symbol, source, .. } = one else {
                if let Self::Converted { source } = *one {
                    return Ok(Self::Converted { source });
                }
                continue;
            };
            let is_in_si = units::Unit::parse(symbol).is_ok_and(|unit| unit.is_coherent());
            if is_in_si || matches!(source, Source::Quantity(_)) {
                continue;
            }
            if let Self::Known {
                symbol: unit,
                source: second @ Source::Quantity(_),
                ..
            } = other
                && may_convert(symbol, unit)
            {
                agreement((symbol, *source), (unit, *second), false, joined)?;
            }
            return Ok(Self::Converted { source: *source });
        }
        Ok(Self::Unknown)
    }

    /// Returns the way in which the value scales another value; `None` if the value may have a unit.
    fn scale(&self) -> Option<Scale> {
        match self {
            Self::Number { is_one } => Some(Scale::by_number(*is_one)),
            Self::Unknown | Self::Converted { .. } => None,
            Self::Known { symbol, source, .. } => {
                let unit = units::Unit::parse(symbol).ok()?;
                unit.is_plain().then_some(match source {
                    Source::Quantity(_) => Scale::Part,
                    _ => Scale::Number,
                })
            }
        }
    }

    /// Returns the unit of the value times a number.
    fn scaled(self, by: Scale) -> Self {
        match (self, by) {
            (Self::Number { .. }, _) => Self::Number { is_one: false },
            (Self::Unknown, _) | (_, Scale::One) => Self::Unknown,
            (converted @ Self::Converted { .. }, _) => converted,
            (
                Self::Known {
                    symbol,
                    source,
                    is_whole,
                    is_scaled,
                },
                by,
            ) => {
                let is_conversion = by == Scale::Number && !matches!(source, Source::Quantity(_));
                Self::Known {
                    symbol,
                    source,
                    is_whole: is_whole && !is_conversion,
                    is_scaled: is_scaled || is_conversion,
                }
            }
        }
    }

    /// Returns `true` if the value may be in another unit than its signals.
    pub(crate) const fn is_converted(&self) -> bool {
        let is_scaled = matches!(self, Self::Known { is_scaled, .. } if *is_scaled);
        is_scaled || matches!(self, Self::Converted { .. })
    }

    /// Returns the unit of the integral over time.
    fn times_s(self) -> Self {
        match self {
            Self::Known {
                symbol,
                is_whole,
                is_scaled,
                ..
            } => Self::Known {
                symbol: times_s(&symbol).into(),
                source: Source::Integral,
                is_whole,
                is_scaled,
            },
            other => other,
        }
    }
}

impl Expression {
    /// Returns the unit of the reduction's value among these columns. An integral over time has the unit of its
    /// expression times s; every other reduction has the unit of its expression.
    ///
    /// # Errors
    /// If the expression adds, subtracts or compares values of different known units.
    pub(crate) fn unit<'a>(&'a self, columns: &'a Columns) -> Result<Unit<'a>, ExpressionError> {
        self.unit_of_ops(&self.ops, columns)
    }

    fn unit_of_ops<'a>(
        &'a self,
        ops: &[Op],
        columns: &'a Columns,
    ) -> Result<Unit<'a>, ExpressionError> {
        let mut stack: Vec<Unit<'a>> = Vec::new();
        for op in ops {
            let mut pop = || stack.pop().unwrap_or(Unit::Unknown);
            let unit = match op {
                Op::Constant(value) => Unit::Number {
                    is_one: *value == 1.0,
                },
                Op::Load(_) => Unit::Unknown,
                Op::Name(index) => {
                    let name = &self.names[*index];
                    let source = Source::Signal(name);
                    match columns.unit_of(&name.path) {
                        Some(symbol) => Unit::Known {
                            symbol: symbol.into(),
                            source,
                            is_whole: true,
                            is_scaled: false,
                        },
                        None if columns.is_converted(&name.path) => Unit::Converted { source },
                        None => Unit::Unknown,
                    }
                }
                Op::Quantity(index) => Unit::of_quantity(&self.quantities[*index]),
                Op::Reduced(index) => {
                    let Reduced { kind, ops, .. } = &self.reductions[*index];
                    let unit = self.unit_of_ops(ops, columns)?;
                    match kind {
                        ReductionKind::Integral => unit.times_s(),
                        _ => unit,
                    }
                }
                Op::Unary(operator) => match (operator, pop()) {
                    (_, Unit::Number { .. }) => Unit::Number { is_one: false },
                    (Unary::Negate | Unary::Abs, unit) => unit,
                    _ => Unit::Unknown,
                },
                Op::Binary(operator) => {
                    let (b, a) = (pop(), pop());
                    self.joined(*operator, a, b)?
                }
            };
            stack.push(unit);
        }
        Ok(stack.pop().unwrap_or(Unit::Unknown))
    }

    fn joined<'a>(
        &self,
        operator: Binary,
        a: Unit<'a>,
        b: Unit<'a>,
    ) -> Result<Unit<'a>, ExpressionError> {
        let mixed_error =
            |mixed: Mixed| self.error(mixed.first.start..mixed.second.end, &mixed.message);
        let (joined, is_truth) = match operator {
            _ if matches!((&a, &b), (Unit::Number { .. }, Unit::Number { .. })) => {
                return Ok(Unit::Number { is_one: false });
            }
            Binary::Add => ("added", false),
            Binary::Subtract => ("subtracted", false),
            Binary::Min | Binary::Max => ("compared", false),
            Binary::Less
            | Binary::LessOrEqual
            | Binary::Greater
            | Binary::GreaterOrEqual
            | Binary::Equal
            | Binary::NotEqual => ("compared", true),
            Binary::Multiply => return a.times(b).map_err(mixed_error),
            Binary::Divide => return a.per(&b).map_err(mixed_error),
            Binary::And | Binary::Or => return Ok(Unit::Unknown),
        };
        let unit = a.with(b, joined).map_err(mixed_error)?;
        Ok(if is_truth { Unit::Unknown } else { unit })
    }
}

/// Multiplies a unit by the second.
fn times_s(unit: &str) -> String {
    if let Some(rest) = unit.strip_suffix("/s2") {
        format!("{rest}/s")
    } else if let Some(rest) = unit.strip_suffix("/s") {
        rest.into()
    } else if unit == "s" {
        "s2".into()
    } else {
        format!("{unit} s")
    }
}
