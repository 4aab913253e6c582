//! Changes of tunable parameters during a run.
//!
//! Only changed parameters are set, because the FMU may hold another value of a parameter that the user did not set,
//! which then stays.

use std::sync::Arc;

use shared_types::failure::Failure;

use super::{Instance, Refused, Status, Values};
use crate::fmi::tables::Column;

/// Parameters that were set before a step, with the values expected after it.
pub(super) struct Changed(pub(super) Vec<(Column, f64)>);

impl Instance {
    /// Sets the tunable parameters whose requested value changed; an array is set as a whole.
    pub(super) fn tune(&mut self) -> Result<Changed, Failure> {
        if self.requested == self.tuned {
            return Ok(Changed(Vec::new()));
        }
        let model = Arc::clone(&self.model);
        let column = |number: usize| &model.tables.parameters[self.tunable_places[number]];
        let is_changed = |&number: &usize| self.requested[number] != self.tuned[number];
        let numbers: Vec<usize> = (0..self.requested.len()).collect();
        let touched: Vec<usize> = numbers
            .chunk_by(|a, b| column(*a).variable == column(*b).variable)
            .filter(|variable| variable.iter().any(is_changed))
            .flatten()
            .copied()
            .collect();
        let columns: Vec<Column> = touched.iter().map(|&n| column(n).clone()).collect();
        let changed = (touched.iter().zip(&columns))
            .filter(|(number, _)| is_changed(number))
            .map(|(&number, column)| (column.clone(), self.requested[number]))
            .collect::<Vec<_>>();
        let mut values = Values::new(&model.description, &columns);
        let mut row: Vec<f64> = touched.iter().map(|&n| self.requested[n]).collect();
        if changed.len() < touched.len() {
            let mut present = vec![0.0; row.len()];
            // SAFETY: the instance is between two steps, and nothing was set since the last one, so it may be read.
            match unsafe { values.get(&self.functions, self.handle, &mut present) } {
                Ok(()) => {
                    let elements = row.iter_mut().zip(present).zip(&touched);
                    for ((value, present), _) in elements.filter(|(_, n)| !is_changed(n)) {
                        *value = present;
                    }
                }
                Err(refused @ Refused::Status(_, Status::Fatal)) => self.accept(Err(refused))?,
                Err(_) => {} // not to be read: the other elements are what they were set to last
            }
        }
        // SAFETY: the instance is between two steps, so tunable parameters may be set.
        let set = unsafe { values.set(&self.functions, self.handle, &row) };
        self.accept(set)?;
        self.tuned.copy_from_slice(&self.requested);
        Ok(Changed(changed))
    }
}
