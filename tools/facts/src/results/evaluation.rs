//! The evaluation of whole records: the same for those that the recorder hears and those that a reader
//! finds in a recording, so that metrics and requirements come out alike to the last bit.

use std::ops::Range;

use hil_config::evaluation::Evaluation;
use hil_config::expression::{Columns, ExpressionError};
use hil_config::plan::Plan;
use shared_types::record::{Event, RecordLayout, Validity};
use shared_types::time::Step;
use shared_types::zerocopy::{FromBytes, IntoBytes};

/// An evaluation that is fed with records.
pub struct RecordEvaluation {
    evaluation: Evaluation,
    /// Places of the signals in a record.
    values: Range<usize>,
    validity: Validity,
}

impl RecordEvaluation {
    /// Begins to evaluate a plan over records with these columns in these places.
    ///
    /// # Errors
    /// If the plan does not fit the columns.
    pub fn new(
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

    /// Begins to evaluate a plan over records of this layout.
    ///
    /// # Errors
    /// If the plan does not fit the layout.
    pub fn of_layout(plan: &Plan, layout: &RecordLayout) -> Result<Self, ExpressionError> {
        let first = layout.values_start();
        let values = first..first + layout.values();
        Self::new(plan, &Columns::from(layout), values, layout.validity())
    }

    /// Takes what happened before the next record.
    pub fn event(&mut self, event: &Event) {
        if let Event::Fault(taken) = event {
            self.evaluation.fault(taken.id, Step(taken.step));
        }
    }

    /// Takes a record; gives the derived signals at its step.
    pub fn record(&mut self, words: &[u64]) -> &[f64] {
        let values = words[self.values.clone()].as_bytes();
        let values = <[f64]>::ref_from_bytes(values).expect("same size and alignment");
        let invalid = self.validity.invalid(words);
        (self.evaluation).observe(Step(words[0]), values, invalid);
        self.evaluation.derived()
    }

    /// Results so far.
    pub const fn so_far(&self) -> &Evaluation {
        &self.evaluation
    }
}
