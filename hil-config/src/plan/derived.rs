//! Sources of derived signals.

use serde::{Deserialize, Serialize};
use shared_types::time::{Rate, Step};

use crate::expression::{Columns, Expression, ExpressionError, Program};
use crate::table::Table;

/// Source of a derived signal.
#[derive(Clone, Debug, PartialEq)]
pub enum DerivedSource {
    /// Value from signals and earlier derived ones.
    Expression(Expression),
    /// Rows of a table.
    Table(Table),
}

/// Source of a derived signal as text and numbers, for a plant's job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Definition {
    /// Text of an expression.
    Expression(String),
    /// Rows of a table.
    Table(Table),
}

/// Source of a derived signal, bound to the columns of a row.
#[derive(Clone, Debug)]
pub(crate) enum BoundSource {
    Program(Program),
    Table(Table),
}

impl From<&str> for Definition {
    fn from(text: &str) -> Self {
        Self::Expression(text.into())
    }
}

impl From<String> for Definition {
    fn from(text: String) -> Self {
        Self::Expression(text)
    }
}

impl DerivedSource {
    /// Returns the expression, if the values are not those of a table.
    #[must_use]
    pub const fn expression(&self) -> Option<&Expression> {
        match self {
            Self::Expression(expression) => Some(expression),
            Self::Table(_) => None,
        }
    }

    /// Returns the definition, from which a plant rebuilds the source.
    #[must_use]
    pub fn definition(&self) -> Definition {
        match self {
            Self::Expression(expression) => Definition::Expression(expression.to_string()),
            Self::Table(table) => Definition::Table(table.clone()),
        }
    }

    /// Binds the source to the columns of a row.
    ///
    /// # Errors
    /// If an expression names an unknown signal or has reductions.
    pub(crate) fn bind(&self, columns: &Columns) -> Result<BoundSource, ExpressionError> {
        Ok(match self {
            Self::Expression(expression) => {
                BoundSource::Program(expression.compile_signal(columns)?)
            }
            Self::Table(table) => BoundSource::Table(table.clone()),
        })
    }
}

impl BoundSource {
    /// Computes the value at a step from its row.
    pub(crate) fn evaluate(&self, step: Step, rate: Rate, row: &[f64]) -> f64 {
        match self {
            Self::Program(program) => program.evaluate(row),
            Self::Table(table) => table.value(rate.seconds(step)),
        }
    }
}
