//! Confirmation of parameters: values are read back after they are set, to detect an FMU that did not accept the
//! scenario's value.
//!
//! If the FMU changes a start value of its own description, which the user did not set, a warning is logged and the
//! run continues.

use std::collections::BTreeSet;
use std::sync::Arc;

use hil_session::program;
use shared_types::failure::Failure;

use super::tuning::Changed;
use super::{Instance, Refused, Status, Values};
use crate::fmi::description::{Causality, Initial, VariableType};
use crate::fmi::tables::Column;

/// Relative difference of a value that counts as rounding.
const ROUNDING: f64 = 1e-12;

/// Parameters that cannot be read back, and those of them that were changed; each is reported only once.
#[derive(Debug, Default)]
pub(super) struct Unconfirmed(BTreeSet<String>, BTreeSet<String>);

impl Unconfirmed {
    /// Names of the parameters that cannot be read.
    pub(super) fn names(&self) -> Vec<String> {
        self.0.iter().cloned().collect()
    }
}

impl Instance {
    /// Compares all parameters with the values that were set.
    pub(super) fn confirm_all(&mut self, row: &[f64]) -> Result<(), Failure> {
        let model = Arc::clone(&self.model);
        let columns = &model.tables.parameters;
        let row = row.iter().copied().map(Some);
        self.confirm(columns.iter().zip(row).collect(), true)
    }

    /// Compares the changed parameters with the values that were set.
    pub(super) fn confirm_changed(&mut self, changed: &Changed) -> Result<(), Failure> {
        if changed.0.is_empty() {
            return Ok(());
        }
        let model = Arc::clone(&self.model);
        // An array is read as a whole.
        let is_touched = |column: &&Column| {
            let mut changed = changed.0.iter();
            changed.any(|(one, _)| one.variable == column.variable)
        };
        let set = |column: &Column| {
            let mut changed = changed.0.iter();
            let one = changed
                .find(|(one, _)| (one.variable, one.element) == (column.variable, column.element));
            one.map(|(_, value)| *value)
        };
        let parameters = (model.tables.parameters.iter())
            .filter(is_touched)
            .map(|column| (column, set(column)));
        self.confirm(parameters.collect(), false)?;
        for (column, _) in &changed.0 {
            let name = &column.field.name;
            if self.unconfirmed.0.contains(name) && self.unconfirmed.1.insert(name.clone()) {
                program::say(&format!(
                    "warning: parameter `{name}` was changed, but the change is unconfirmed, because the FMU does not let it be read"
                ));
            }
        }
        Ok(())
    }

    /// Compares exact initial values with the values that were set. A difference is only reported, because the
    /// equations may change the value at the start, unless it is a parameter.
    pub(super) fn confirm_initial(&mut self) -> Result<(), Failure> {
        let model = Arc::clone(&self.model);
        let variable = |column: &Column| &model.description.variables[column.variable];
        let preset = &model.start.initial;
        let (columns, row): (Vec<Column>, Vec<f64>) = (preset.columns.iter().zip(&preset.row))
            .filter(|(column, _)| {
                let variable = variable(column);
                variable.initial == Initial::Exact || variable.causality == Causality::Parameter
            })
            .map(|(column, value)| (column.clone(), *value))
            .unzip();
        let mut values = Values::new(&model.description, &columns);
        let mut read = vec![0.0; columns.len()];
        // SAFETY: the instance is initialised, so every variable may be read.
        match unsafe { values.get(&self.functions, self.handle, &mut read) } {
            Err(refused @ Refused::Status(_, Status::Fatal)) => return self.accept(Err(refused)),
            Err(_) => return Ok(()),
            Ok(()) => {}
        }
        for ((column, &set), &has) in columns.iter().zip(&row).zip(&read) {
            if !is_same(variable(column).kind, set, has) {
                let name = &column.field.name;
                if variable(column).causality == Causality::Parameter {
                    self.other_start.get_or_insert(difference(name, set, has));
                    continue;
                }
                program::say(&format!(
                    "warning: the initial value of `{name}` was set to {set}, but the FMU begins with {has}"
                ));
            }
        }
        Ok(())
    }

    /// Reads these parameters, one by one if that fails, and compares those that have an expected value.
    fn confirm(
        &mut self,
        mut parameters: Vec<(&Column, Option<f64>)>,
        is_start: bool,
    ) -> Result<(), Failure> {
        parameters.retain(|(column, _)| !self.unconfirmed.0.contains(&column.field.name));
        let (columns, row): (Vec<Column>, Vec<Option<f64>>) = (parameters.iter())
            .map(|(column, value)| ((*column).clone(), *value))
            .unzip();
        let (Some(first), Some(last)) = (columns.first(), columns.last()) else {
            return Ok(());
        };
        let mut values = Values::new(&self.model.description, &columns);
        let mut read = vec![0.0; columns.len()];
        // SAFETY: the instance is initialised, and nothing was set since its last step, so every variable may be
        // read.
        match unsafe { values.get(&self.functions, self.handle, &mut read) } {
            Ok(()) => self.compare(&columns, &row, &read, is_start),
            Err(refused @ Refused::Status(_, Status::Fatal)) => self.accept(Err(refused)),
            Err(_) if first.variable == last.variable => {
                for column in &columns {
                    let name = &column.field.name;
                    program::say(&format!(
                        "fmu: parameter `{name}` is unconfirmed, because the FMU does not let it be read"
                    ));
                    self.unconfirmed.0.insert(name.clone());
                }
                Ok(())
            }
            Err(_) => (parameters.chunk_by(|(a, _), (b, _)| a.variable == b.variable))
                .try_for_each(|variable| self.confirm(variable.to_vec(), is_start)),
        }
    }

    /// Compares values. A difference at the start is kept for the caller that runs the instance, because an instance
    /// that only tries later values may be initialised to others.
    fn compare(
        &mut self,
        columns: &[Column],
        row: &[Option<f64>],
        read: &[f64],
        is_start: bool,
    ) -> Result<(), Failure> {
        for ((column, set), &has) in columns.iter().zip(row).zip(read) {
            let Some(set) = *set else { continue };
            let kind = self.model.description.variables[column.variable].kind;
            if !is_same(kind, set, has) {
                let name = &column.field.name;
                if is_start && column.field.default == Some(set) {
                    program::say(&format!(
                        "warning: parameter `{name}` starts at {set} according to the FMU's own description, but the FMU has {has}"
                    ));
                    continue;
                }
                let difference = difference(name, set, has);
                if !is_start {
                    return Err(Failure::lost(difference));
                }
                self.other_start.get_or_insert(difference);
            }
        }
        Ok(())
    }
}

fn difference(name: &str, set: f64, has: f64) -> String {
    format!("parameter `{name}` was set to {set}, but the FMU has {has}")
}

/// Returns `true` if `has` is the value of a variable of this type after it was set to `set`.
fn is_same(kind: VariableType, set: f64, has: f64) -> bool {
    match kind {
        #[expect(clippy::cast_possible_truncation, reason = "it was set as such")]
        VariableType::Float32 => f64::from(set as f32) == has || (set.is_nan() && has.is_nan()),
        // In C any nonzero number is true.
        VariableType::Boolean => (set != 0.0) == (has != 0.0),
        // Models convert units internally, with rounding in each direction.
        VariableType::Float64 => {
            (set - has).abs() <= ROUNDING * set.abs()
                || set == has
                || (set.is_nan() && has.is_nan())
        }
        _ => set == has,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_compared_according_to_their_type() {
        for (kind, set, has, expected) in [
            (VariableType::Float64, 0.1, 0.1, true),
            (VariableType::Float64, 0.1, f64::from(0.1_f32), false),
            (VariableType::Float64, 2.9, 2.9 + 4.0 * f64::EPSILON, true),
            (VariableType::Float64, f64::INFINITY, f64::INFINITY, true),
            (VariableType::Float64, 0.0, 1e-300, false),
            (VariableType::Float32, 0.1, f64::from(0.1_f32), true),
            (VariableType::Float32, 0.1, 0.25, false),
            (VariableType::Boolean, 1.0, -1.0, true),
            (VariableType::Boolean, 1.0, 0.0, false),
            (VariableType::Int32, 7.0, 5.0, false),
            (VariableType::Float64, f64::NAN, f64::NAN, true),
        ] {
            assert_eq!(is_same(kind, set, has), expected, "{kind:?} {set} {has}");
        }
    }
}
