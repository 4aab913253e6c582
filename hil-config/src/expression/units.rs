//! The units of what an expression computes, as far as they are known.

use shared_types::table::unit_of_name;

use super::program::{Binary, Op, Unary, keeps_unit};
use super::{Columns, Expression, ExpressionError, Name, Reduced, ReductionKind};

/// A known unit, and the first signal of the expression that tells it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct KnownUnit<'a> {
    unit: &'a str,
    name: &'a Name,
}

impl KnownUnit<'_> {
    /// Place of the signal in its expression, in bytes.
    pub(crate) const fn span(&self) -> &std::ops::Range<usize> {
        &self.name.span
    }

    /// Why two cannot be `joined`, as in "added"; `None` if they can.
    pub(crate) fn refusal(&self, other: &Self, joined: &str) -> Option<String> {
        let (unit, others) = (self.unit, other.unit);
        let (name, second) = (&self.name.path, &other.name.path);
        (unit != others).then(|| {
            format!(
                "`{name}` is in {unit} and `{second}` in {others}, which cannot be {joined}; if it is meant, write a factor, as in `1 * {second}`"
            )
        })
    }
}

impl Expression {
    /// The unit of its value as far as the names of its signals tell it. An integral over time has that
    /// of its expression times s, every other reduction that of its expression.
    pub(crate) fn unit(&self) -> Option<String> {
        self.told_unit(&self.ops)
    }

    fn told_unit(&self, ops: &[Op]) -> Option<String> {
        if !keeps_unit(ops) {
            return None;
        }
        let mut units = ops.iter().filter_map(|op| match *op {
            Op::Name(name) => Some(unit_of_name(&self.names[name].path).map(Into::into)),
            Op::Reduced(index) => {
                let Reduced { kind, ops, .. } = &self.reductions[index];
                let unit = self.told_unit(ops);
                Some(match kind {
                    ReductionKind::Integral => unit.as_deref().map(times_s),
                    _ => unit,
                })
            }
            _ => None,
        });
        let first: String = units.next()??;
        units
            .all(|unit| unit.as_ref() == Some(&first))
            .then_some(first)
    }

    /// The unit of its value among these columns, if that is known. Plain numbers fit every unit, and so
    /// does what is multiplied, divided or integrated.
    ///
    /// # Errors
    /// If it adds, subtracts or compares values of two known units.
    pub(crate) fn known_unit<'a>(
        &'a self,
        columns: &'a Columns,
    ) -> Result<Option<KnownUnit<'a>>, ExpressionError> {
        self.unit_of_ops(&self.ops, columns)
    }

    fn unit_of_ops<'a>(
        &'a self,
        ops: &[Op],
        columns: &'a Columns,
    ) -> Result<Option<KnownUnit<'a>>, ExpressionError> {
        let mut stack = Vec::new();
        for op in ops {
            let unit = match op {
                Op::Constant(_) | Op::Load(_) => None,
                Op::Name(index) => {
                    let name = &self.names[*index];
                    let unit = columns.unit_of(&name.path);
                    unit.map(|unit| KnownUnit { unit, name })
                }
                Op::Reduced(index) => {
                    let Reduced { kind, ops, .. } = &self.reductions[*index];
                    let unit = self.unit_of_ops(ops, columns)?;
                    unit.filter(|_| *kind != ReductionKind::Integral)
                }
                Op::Unary(operator) => {
                    let unit: Option<KnownUnit<'a>> = stack.pop().flatten();
                    unit.filter(|_| matches!(operator, Unary::Negate | Unary::Abs))
                }
                Op::Binary(operator) => {
                    let (b, a) = (stack.pop().flatten(), stack.pop().flatten());
                    self.joined(*operator, a, b)?
                }
            };
            stack.push(unit);
        }
        Ok(stack.pop().flatten())
    }

    fn joined<'a>(
        &self,
        operator: Binary,
        a: Option<KnownUnit<'a>>,
        b: Option<KnownUnit<'a>>,
    ) -> Result<Option<KnownUnit<'a>>, ExpressionError> {
        let (joined, unit) = match operator {
            Binary::Add => ("added", a.or(b)),
            Binary::Subtract => ("subtracted", a.or(b)),
            Binary::Min | Binary::Max => ("compared", a.or(b)),
            Binary::Less
            | Binary::LessOrEqual
            | Binary::Greater
            | Binary::GreaterOrEqual
            | Binary::Equal
            | Binary::NotEqual => ("compared", None),
            Binary::Multiply | Binary::Divide | Binary::And | Binary::Or => return Ok(None),
        };
        if let (Some(a), Some(b)) = (a, b)
            && let Some(message) = a.refusal(&b, joined)
        {
            return Err(self.error(a.span().start..b.span().end, &message));
        }
        Ok(unit)
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
