//! Evaluation of whole records. The recorder and the readers of recordings use the same code, so that metrics and
//! requirements agree to the last bit.

use std::ops::Range;

use hil_config::evaluation::Evaluation;
use hil_config::expression::{Columns, ExpressionError};
use hil_config::plan::Plan;
use shared_types::record::{Event, RecordLayout, Validity};
use shared_types::time::Step;
use shared_types::zerocopy::{FromBytes, IntoBytes};

/// Evaluation fed with records.
#[derive(Clone)]
pub struct RecordEvaluation {
    evaluation: Evaluation,
    /// Range of the signals in a record.
    values: Range<usize>,
    validity: Validity,
}

impl RecordEvaluation {
    /// Starts the evaluation of a plan over records with these columns at these positions.
    ///
    /// # Errors
    /// If the plan does not fit the columns.
    pub(crate) fn new(
        plan: &Plan,
        columns: &Columns,
        values: Range<usize>,
        validity: Validity,
    ) -> Result<Self, ExpressionError> {
        Ok(Self {
            evaluation: Evaluation::new(plan, columns)?,
            values,
            validity,
        })
    }

    /// Starts the evaluation of a plan over records of this layout.
    ///
    /// # Errors
    /// If the plan does not fit the layout.
    pub fn of_layout(plan: &Plan, layout: &RecordLayout) -> Result<Self, ExpressionError> {
        let first = layout.values_start();
        let values = first..first + layout.values();
        Self::new(plan, &Columns::from(layout), values, layout.validity())
    }

    /// Adds an event before the next record.
    pub fn event(&mut self, event: &Event) {
        if let Event::Fault(fault) = event {
            self.evaluation.fault(fault.id, Step(fault.step));
        }
    }

    /// Adds a record; returns the derived signals at its step.
    pub fn record(&mut self, words: &[u64]) -> &[f64] {
        let values = words[self.values.clone()].as_bytes();
        let values = <[f64]>::ref_from_bytes(values).expect("same size and alignment");
        let invalid = self.validity.invalid(words);
        (self.evaluation).observe(Step(words[0]), values, invalid);
        self.evaluation.derived()
    }

    /// Returns the signals of the last record with the derived ones behind them; NaN for missing values.
    #[must_use]
    pub fn row(&self) -> &[f64] {
        self.evaluation.row()
    }

    /// Returns the results so far.
    pub const fn so_far(&self) -> &Evaluation {
        &self.evaluation
    }
}
