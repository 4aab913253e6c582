//! Expressions over signals: one grammar for derived signals, metrics and fault conditions.
//!
//! Parsed by the check, which resolves every name; computed by an [`Evaluation`](crate::evaluation::Evaluation) or a
//! [`Watch`](crate::condition::Watch) as records arrive. Evaluation never allocates and depends only on a row of
//! numbers.
//!
//! ```text
//! expression  = conjunction { "or" conjunction }
//! conjunction = negation { "and" negation }
//! negation    = "not" negation | comparison
//! comparison  = sum [ ("<" | "<=" | ">" | ">=" | "==" | "!=") sum ]
//! sum         = product { ("+" | "-") product }
//! product     = sign { ("*" | "/") sign }
//! sign        = "-" sign | number [ unit ] | signal | call | "(" expression ")"
//! signal      = group "." name { "." name }
//!             | name of a derived signal
//! group       = "truth" | "measured" | "reference" | "command" | "applied" | "internal"
//!             | "input" | "sensed" | "stimulus" | "parameter" | "sensor" | "actuator"
//! call        = ("abs" | "sqrt" | "valid") "(" expression ")"
//!             | ("min" | "max") "(" expression "," expression ")"
//!             | reduction "(" expression ")"
//! reduction   = "max_abs" | "max" | "min" | "mean" | "rms" | "initial" | "final" | "integral"
//! ```
//!
//! `measured` and `reference` are the signals that the controller received; `sensed` and `stimulus` are the same
//! signals before any fault. A `parameter` has its full name, as in `parameter.actuator1.bulk_modulus_pa`.
//!
//! Values of different known units can be neither added nor compared. A plain number is compatible with every unit, and
//! so is a product or quotient of two quantities. A quantity times or divided by a plain number keeps its dimension. A
//! number with a unit counts in coherent SI units: `5 cm` is 0.05 and is compatible with signals in m.
//!
//! A comparison is 1 if it holds and 0 otherwise; every number except 0 counts as true.
//!
//! **A missing value** is NaN, like the command in the final record, and so is the root of a negative number. Any
//! result computed from a missing value is missing too, including comparisons and `and`, `or`, `not`, `min`, `max`. A
//! reduction skips rows where its expression is missing and counts them; if it skips all rows, its own result is
//! missing. Only `valid` makes a number of a missing value: 1 where its expression has a value, 0 where it is missing.
//!
//! **Reductions** ([`ReductionKind`]) convert the rows of a window into one number. A metric needs at least one
//! reduction and may compute with reductions, as in `max(x) - min(x)`; a derived signal has none.

mod columns;
pub(crate) mod cursor;
pub(crate) mod lexer;
mod parser;
mod program;
mod quantity;
mod reduction;
pub(crate) mod spellings;
mod units;

use std::ops::Range;

use crate::problem::MOST_PROBLEMS;

pub use columns::{Columns, Group};
pub use program::Program;
pub use reduction::{Accumulator, Reduction, ReductionKind};

pub(crate) use parser::{VALID, functions, is_reserved};
use program::{Op, Unary};
use quantity::Quantity;
pub(crate) use units::Unit;

/// Expression, parsed but not yet bound to columns.
#[derive(Clone, Debug, PartialEq)]
pub struct Expression {
    text: String,
    /// Operations in reverse Polish order: operands first.
    ops: Vec<Op>,
    /// Signals named in the expression.
    names: Vec<Name>,
    /// Numbers with units in the expression.
    quantities: Box<[Quantity]>,
    reductions: Vec<Reduced>,
}

/// Signal name in an expression.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Name {
    path: String,
    span: Range<usize>,
    /// `true` if the name is inside a reduction.
    reduced: bool,
}

/// Reduction in an expression.
#[derive(Clone, Debug, PartialEq)]
struct Reduced {
    kind: ReductionKind,
    ops: Vec<Op>,
    span: Range<usize>,
}

/// Error in an expression.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("column {column} of the expression: {message}")]
pub struct ExpressionError {
    /// Description of the error.
    pub message: String,
    /// Column in the expression, in characters from 1.
    pub column: usize,
    /// Faulty bytes of the expression.
    pub span: Range<usize>,
    /// Existing names that are closest to an unknown one.
    pub nearest: Vec<String>,
}

impl ExpressionError {
    pub(crate) fn new(text: &str, span: Range<usize>, message: impl Into<String>) -> Self {
        Self {
            message: message.into(),
            column: text[..span.start].chars().count() + 1,
            span,
            nearest: Vec::new(),
        }
    }

    /// Relocates the error if the expression is a part of a longer text, from byte `start` on.
    pub(crate) fn inside(self, text: &str, start: usize) -> Self {
        let span = self.span.start + start..self.span.end + start;
        Self {
            nearest: self.nearest,
            ..Self::new(text, span, self.message)
        }
    }
}

impl std::fmt::Display for Expression {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.text.fmt(f)
    }
}

impl Expression {
    /// Parses an expression.
    ///
    /// # Errors
    /// If the text is malformed, reduces a reduction, or mixes a reduction with a bare signal.
    pub fn parse(text: &str) -> Result<Self, ExpressionError> {
        parser::parse(text)
    }

    /// Lists the signals named in the expression.
    pub fn signals(&self) -> impl Iterator<Item = &str> {
        self.names.iter().map(|name| name.path.as_str())
    }

    /// Returns the signal if the expression is a single signal or its magnitude, with `true` for a magnitude.
    #[must_use]
    pub fn plain_signal(&self) -> Option<(&str, bool)> {
        match *self.ops.as_slice() {
            [Op::Name(name)] => Some((&self.names[name].path, false)),
            [Op::Name(name), Op::Unary(Unary::Abs)] => Some((&self.names[name].path, true)),
            _ => None,
        }
    }

    /// Computes the value if the expression consists of numbers only.
    #[must_use]
    pub fn constant(&self) -> Option<f64> {
        if !self.is_constant() {
            return None;
        }
        let program = self.compile_signal(&Columns::default()).ok()?;
        Some(program.evaluate(&[]))
    }

    /// Returns `true` if the expression consists of numbers only.
    pub(crate) fn is_constant(&self) -> bool {
        self.names.is_empty()
    }

    /// Returns `true` if the expression is a truth value, not a quantity.
    pub(crate) fn is_truth(&self) -> bool {
        self.ops.last().is_some_and(|last| last.is_truth())
    }

    /// Returns an error for each name that no column has, up to a limit.
    #[must_use]
    pub fn unknown_names(&self, columns: &Columns) -> Vec<ExpressionError> {
        let unknown = (self.names.iter()).filter_map(|name| self.column(name, columns).err());
        unknown.take(MOST_PROBLEMS + 1).collect()
    }

    /// Lists the aliases in the expression, with the names of their columns, in text order.
    pub(crate) fn aliases<'a>(
        &'a self,
        columns: &'a Columns,
    ) -> impl Iterator<Item = (Range<usize>, &'a str)> {
        let own = |name: &'a Name| {
            let own = columns.own_name(&name.path);
            (own != name.path).then(|| (name.span.clone(), own))
        };
        let mut aliases: Vec<_> = self.names.iter().filter_map(own).collect();
        aliases.sort_by_key(|(span, _)| span.start);
        aliases.into_iter()
    }

    /// Replaces aliases by the names of their columns, which recordings use.
    ///
    /// # Errors
    /// If the text would exceed the maximum length.
    pub(crate) fn with_own_names(self, columns: &Columns) -> Result<Self, ExpressionError> {
        match replaced(&self.text, self.aliases(columns)) {
            Some(text) => Self::parse(&text),
            None => Ok(self),
        }
    }

    /// Refuses an expression with reductions, because a derived signal must not have any.
    ///
    /// # Errors
    /// If the expression has a reduction.
    pub fn refuse_reduction(&self) -> Result<(), ExpressionError> {
        match self.reductions.first() {
            None => Ok(()),
            Some(reduced) => Err(self.error(
                reduced.span.clone(),
                "a reduction needs a window, so it can be used only in [[metrics]]",
            )),
        }
    }

    /// Refuses an expression without reductions, because a metric needs at least one.
    ///
    /// # Errors
    /// If the expression has no reduction.
    pub fn refuse_signal(&self) -> Result<(), ExpressionError> {
        if self.reductions.is_empty() {
            let message = "a metric needs a reduction, such as max_abs(..)";
            return Err(self.error(0..self.text.len(), message));
        }
        Ok(())
    }

    /// Binds the expression of a derived signal to columns.
    ///
    /// # Errors
    /// If a name is unknown or the expression has reductions.
    pub fn compile_signal(&self, columns: &Columns) -> Result<Program, ExpressionError> {
        self.refuse_reduction()?;
        self.bind(&self.ops, columns)
    }

    /// Binds the expression of a metric to columns: its reductions, and the computation on their results.
    ///
    /// # Errors
    /// If a name is unknown or the expression has no reduction.
    pub fn compile_metric(
        &self,
        columns: &Columns,
    ) -> Result<(Vec<Reduction>, Program), ExpressionError> {
        self.refuse_signal()?;
        let reductions = self
            .reductions
            .iter()
            .map(|Reduced { kind, ops, .. }| {
                Ok(Reduction {
                    kind: *kind,
                    program: self.bind(ops, columns)?,
                })
            })
            .collect::<Result<_, _>>()?;
        Ok((reductions, self.bind(&self.ops, columns)?))
    }

    fn bind(&self, ops: &[Op], columns: &Columns) -> Result<Program, ExpressionError> {
        let ops = ops
            .iter()
            .map(|&op| match op {
                Op::Name(index) => self.column(&self.names[index], columns).map(Op::Load),
                Op::Quantity(index) => Ok(Op::Constant(self.quantities[index].value())),
                Op::Reduced(index) => Ok(Op::Load(index)),
                op => Ok(op),
            })
            .collect::<Result<_, _>>()?;
        Ok(Program::new(ops))
    }

    fn column(&self, name: &Name, columns: &Columns) -> Result<usize, ExpressionError> {
        columns.index_of(&name.path).ok_or_else(|| {
            let message = match name.path.split_once('.') {
                Some((prefix, _)) if !columns.has_prefix(prefix) => {
                    format!("unknown kind of signal `{prefix}`")
                }
                Some((prefix, _)) if prefix == Group::Truth.prefix() && !columns.has_truth() => {
                    format!("the plant has no truth, so there is no `{}`", name.path)
                }
                Some(_) => format!("unknown signal `{}`", name.path),
                None => {
                    let unit = shared_types::units::symbol_of_word(&name.path);
                    let unit = unit.map_or(String::new(), |unit| format!("; the unit is `{unit}`"));
                    format!("unknown derived signal `{}`{unit}", name.path)
                }
            };
            let mut error = self.error(name.span.clone(), &message);
            error.nearest = columns.nearest(&name.path);
            error
        })
    }

    fn error(&self, span: Range<usize>, message: &str) -> ExpressionError {
        ExpressionError::new(&self.text, span, message)
    }
}

/// Replaces consecutive spans of a text; `None` if there are none.
pub(crate) fn replaced<'a>(
    text: &str,
    words: impl Iterator<Item = (Range<usize>, &'a str)>,
) -> Option<String> {
    let (mut result, mut end) = (String::new(), 0);
    for (span, word) in words {
        result += &text[end..span.start];
        result += word;
        end = span.end;
    }
    (end > 0).then(|| result + &text[end..])
}
