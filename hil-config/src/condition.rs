//! Conditions of faults, evaluated as records arrive: an expression must hold for long enough.
//!
//! Created by the plant from a [`Condition`] of a checked scenario and the columns of its records, then fed one record
//! at each step in the loop. Evaluation allocates nothing and depends only on the record.

use shared_types::table::canonical;
use shared_types::time::{Rate, Step};

use crate::expression::{Columns, Expression, ExpressionError, Group, Program};
use crate::plan::{BoundSource, Condition, Definition};

/// Condition under observation.
#[derive(Clone, Debug)]
pub struct Watch {
    expression: Program,
    /// Derived signals that the expression needs: column and source.
    derived: Vec<(usize, BoundSource)>,
    rate: Rate,
    /// Record followed by the derived signals; empty if the expression needs none.
    row: Vec<f64>,
    /// Number of columns in a record.
    signals: usize,
    /// Number of consecutive records for which the expression must hold.
    records: u64,
    /// Number of consecutive records for which the expression has held.
    held: u64,
}

impl Watch {
    /// Creates a condition before the first record of a run at a rate. `derived` are the scenario's derived signals by
    /// name and definition, each using only signals and earlier ones; `columns` are those of a record.
    ///
    /// # Errors
    /// If an expression is malformed or names an unknown signal.
    pub fn new(
        condition: &Condition,
        derived: &[(String, Definition)],
        columns: &Columns,
        rate: Rate,
    ) -> Result<Self, ExpressionError> {
        let expression = Expression::parse(&condition.expression)?;
        let mut all = columns.clone();
        for (name, _) in derived {
            all.push(Group::Derived, name);
        }
        let mut names: Vec<String> = expression.signals().map(Into::into).collect();
        let mut needed = Vec::new();
        // From last to first, so that the users of a derived signal are seen before the signal itself.
        for (index, (name, definition)) in derived.iter().enumerate().rev() {
            if !names.contains(name) {
                continue;
            }
            let source = match definition {
                Definition::Expression(text) => {
                    let signal = Expression::parse(text)?;
                    names.extend(signal.signals().map(Into::into));
                    BoundSource::Program(signal.compile_signal(&all)?)
                }
                Definition::Table(table) => BoundSource::Table(table.clone()),
            };
            needed.push((columns.len() + index, source));
        }
        needed.reverse();
        let row = match needed.last() {
            Some((last, _)) => vec![f64::NAN; last + 1],
            None => Vec::new(),
        };
        Ok(Self {
            expression: expression.compile_signal(&all)?,
            derived: needed,
            rate,
            row,
            signals: columns.len(),
            records: condition.records,
            held: 0,
        })
    }

    /// Evaluates the record of a step, the next one; returns `true` if the expression has held for long enough, including this record. A
    /// missing value counts as not holding.
    ///
    /// # Panics
    /// If the record does not have as many values as there are columns.
    pub fn observe(&mut self, step: Step, row: &[f64]) -> bool {
        let value = if self.derived.is_empty() {
            self.expression.evaluate(row)
        } else {
            self.row[..self.signals].copy_from_slice(row);
            for (column, source) in &self.derived {
                self.row[*column] = canonical(source.evaluate(step, self.rate, &self.row));
            }
            self.expression.evaluate(&self.row)
        };
        let holds = !value.is_nan() && value != 0.0;
        self.held = if holds { self.held + 1 } else { 0 };
        self.held >= self.records
    }

    /// Returns the number of consecutive records for which the expression has held.
    #[must_use]
    pub const fn held(&self) -> u64 {
        self.held
    }

    /// Continues as if the expression had held for N records.
    pub const fn go_on_from(&mut self, held: u64) {
        self.held = held;
    }

    /// Resets the count of records.
    pub fn reset(&mut self) {
        self.held = 0;
    }
}
