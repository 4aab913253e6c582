//! The units of what an expression computes, as far as they are known.

use std::borrow::Cow;
use std::ops::Range;

use super::program::{Binary, Op, Unary};
use super::{Columns, Expression, ExpressionError, Name, Reduced, ReductionKind};

/// The unit of a value, as far as it is known.
#[derive(Clone, Debug)]
pub(crate) enum Unit<'a> {
    /// A plain number, which fits every unit.
    Number,
    /// Nothing: that of a product, a quotient, a truth, or of a signal that has none.
    Unknown,
    /// A unit.
    Known {
        symbol: Cow<'a, str>,
        /// The first signal that tells it. An integral has none: its unit is shown, but not held against
        /// others, as J and W s are one.
        name: Option<&'a Name>,
        /// True unless a value of unknown unit was added or compared.
        is_whole: bool,
    },
}

/// Two known units that do not go together, with the places of the signals that tell them, in bytes of
/// their expressions.
pub(crate) struct Mixed {
    pub(crate) message: String,
    pub(crate) first: Range<usize>,
    pub(crate) second: Range<usize>,
}

impl<'a> Unit<'a> {
    /// The unit, if it is that of the whole value.
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

    /// The unit of two that are `joined`, as in "added".
    ///
    /// # Errors
    /// If two are known and differ.
    pub(crate) fn with(self, other: Self, joined: &str) -> Result<Self, Mixed> {
        let (a, b) = match (self, other) {
            (Self::Number, unit) | (unit, Self::Number) => return Ok(unit),
            (a, Self::Unknown) => (Self::Unknown, a),
            (a, b) => (a, b),
        };
        match (a, b) {
            (Self::Unknown, Self::Known { symbol, name, .. }) => Ok(Self::Known {
                symbol,
                name,
                is_whole: false,
            }),
            (
                Self::Known {
                    symbol,
                    name,
                    is_whole,
                },
                Self::Known {
                    symbol: others,
                    name: second,
                    is_whole: is_other_whole,
                },
            ) => match (name, second) {
                _ if symbol == others => Ok(Self::Known {
                    symbol,
                    name: name.or(second),
                    is_whole: is_whole && is_other_whole,
                }),
                (Some(name), Some(second)) => {
                    let (path, span) = (&second.path, &second.span);
                    Err(Mixed {
                        message: format!(
                            "`{}` is in {symbol} and `{path}` in {others}, which cannot be {joined}; if it is meant, write a factor, as in `1 * {path}`",
                            name.path
                        ),
                        first: name.span.clone(),
                        second: span.clone(),
                    })
                }
                _ => Ok(Self::Unknown),
            },
            _ => Ok(Self::Unknown),
        }
    }

    /// The unit of the integral over time.
    fn times_s(self) -> Self {
        match self {
            Self::Known {
                symbol, is_whole, ..
            } => Self::Known {
                symbol: times_s(&symbol).into(),
                name: None,
                is_whole,
            },
            other => other,
        }
    }
}

impl Expression {
    /// The unit of its value among these columns. An integral over time has that of its expression times
    /// s, every other reduction that of its expression.
    ///
    /// # Errors
    /// If it adds, subtracts or compares values of two known units.
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
                Op::Constant(_) => Unit::Number,
                Op::Load(_) => Unit::Unknown,
                Op::Name(index) => {
                    let name = &self.names[*index];
                    let unit = columns.unit_of(&name.path);
                    unit.map_or(Unit::Unknown, |symbol| Unit::Known {
                        symbol: symbol.into(),
                        name: Some(name),
                        is_whole: true,
                    })
                }
                Op::Reduced(index) => {
                    let Reduced { kind, ops, .. } = &self.reductions[*index];
                    let unit = self.unit_of_ops(ops, columns)?;
                    match kind {
                        ReductionKind::Integral => unit.times_s(),
                        _ => unit,
                    }
                }
                Op::Unary(operator) => match (operator, pop()) {
                    (Unary::Negate | Unary::Abs, unit) | (_, unit @ Unit::Number) => unit,
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
        let (joined, is_truth) = match operator {
            _ if matches!((&a, &b), (Unit::Number, Unit::Number)) => return Ok(Unit::Number),
            Binary::Add => ("added", false),
            Binary::Subtract => ("subtracted", false),
            Binary::Min | Binary::Max => ("compared", false),
            Binary::Less
            | Binary::LessOrEqual
            | Binary::Greater
            | Binary::GreaterOrEqual
            | Binary::Equal
            | Binary::NotEqual => ("compared", true),
            Binary::Multiply | Binary::Divide | Binary::And | Binary::Or => {
                return Ok(Unit::Unknown);
            }
        };
        let unit = a
            .with(b, joined)
            .map_err(|mixed| self.error(mixed.first.start..mixed.second.end, &mixed.message))?;
        Ok(if is_truth { Unit::Unknown } else { unit })
    }
}

/// A unit times the second.
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
