//! Conditions of faults while records arrive: whether an expression has held for long enough.
//!
//! Made by the plant from a [`Condition`] of a checked scenario and the columns of its records, then
//! shown one record per step, in the loop: looking allocates nothing. Never looks at anything but
//! the record.

use shared_types::table::canonical;

use crate::expression::{Columns, Expression, ExpressionError, Group, Program};
use crate::plan::Condition;

/// A condition that is being watched.
#[derive(Clone, Debug)]
pub struct Watch {
    expression: Program,
    /// Of the derived signals that the expression needs: column and value.
    derived: Vec<(usize, Program)>,
    /// A record, then the derived signals; empty if none is needed.
    row: Vec<f64>,
    /// Columns of a record.
    signals: usize,
    /// For how many records in a row it must hold.
    records: u64,
    /// For how many it has held.
    held: u64,
}

impl Watch {
    /// A condition before the first record. `derived` are the scenario's derived signals by name
    /// and expression, each using only signals and earlier ones; `columns` are those of a record.
    ///
    /// # Errors
    /// If an expression does not follow the grammar or names a signal that there is not.
    pub fn new(
        condition: &Condition,
        derived: &[(String, String)],
        columns: &Columns,
    ) -> Result<Self, ExpressionError> {
        let expression = Expression::parse(&condition.expression)?;
        let mut all = columns.clone();
        for (name, _) in derived {
            all.push(Group::Derived, name);
        }
        let mut wanted: Vec<String> = expression.signals().map(Into::into).collect();
        let mut needed = Vec::new();
        // From the last to the first: what is needed only for another is known before it is met.
        for (index, (name, text)) in derived.iter().enumerate().rev() {
            if wanted.contains(name) {
                let signal = Expression::parse(text)?;
                wanted.extend(signal.signals().map(Into::into));
                needed.push((columns.len() + index, signal.compile_signal(&all)?));
            }
        }
        needed.reverse();
        let row = match needed.last() {
            Some((last, _)) => vec![f64::NAN; last + 1],
            None => Vec::new(),
        };
        Ok(Self {
            expression: expression.compile_signal(&all)?,
            derived: needed,
            row,
            signals: columns.len(),
            records: condition.records,
            held: 0,
        })
    }

    /// Takes the next record's values; whether the expression has held long enough, this record
    /// included. A value that does not exist does not hold.
    ///
    /// # Panics
    /// If the record does not have as many values as there are columns.
    pub fn observe(&mut self, row: &[f64]) -> bool {
        let value = if self.derived.is_empty() {
            self.expression.evaluate(row)
        } else {
            self.row[..self.signals].copy_from_slice(row);
            for (column, program) in &self.derived {
                self.row[*column] = canonical(program.evaluate(&self.row));
            }
            self.expression.evaluate(&self.row)
        };
        let holds = !value.is_nan() && value != 0.0;
        self.held = if holds { self.held + 1 } else { 0 };
        self.held >= self.records
    }

    /// For how many records in a row it has held.
    #[must_use]
    pub const fn held(&self) -> u64 {
        self.held
    }

    /// Goes on as if it had held for N records.
    pub const fn go_on_from(&mut self, held: u64) {
        self.held = held;
    }

    /// Forgets for how long it has held.
    pub fn reset(&mut self) {
        self.held = 0;
    }
}
