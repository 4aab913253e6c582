//! State of an instance: the numbers of a table, or a plain value of its own methods.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::{IntoPyObjectExt, intern};
use shared_types::state::{State, check_count};
use shared_types::table::Field;

use super::plain;
use super::tables::Rows;

/// Way in which an instance is saved.
pub(super) struct Saving {
    /// `true` if the class has `save` and `restore`.
    is_own: bool,
    /// Named numbers.
    rows: Option<Rows>,
}

impl Saving {
    /// Reads the way from a declaration.
    pub(super) fn of(side: &Bound<'_, PyAny>, is_own: bool) -> PyResult<Self> {
        let state = side.getattr("state")?;
        let rows = (!state.is_none()).then(|| Rows::of(&state)).transpose()?;
        Ok(Self { is_own, rows })
    }

    /// Returns `true` if a run can be saved.
    pub(super) const fn saves(&self) -> bool {
        self.is_own || self.rows.is_some()
    }

    /// Returns the names of the numbers, if they have names.
    pub(super) fn fields(&self) -> Option<Vec<Field>> {
        self.rows.as_ref().map(|rows| rows.fields.clone())
    }

    /// Returns the state of an instance.
    pub(super) fn save(&self, instance: &Bound<'_, PyAny>) -> PyResult<State> {
        let py = instance.py();
        let state = if self.is_own {
            let value = instance.call_method0(intern!(py, "save"))?;
            State::of(&plain::words(&value)?)
        } else {
            State::of(&self.rows()?.attributes(instance)?)
        };
        state.map_err(refused)
    }

    /// Restores a state.
    pub(super) fn restore(&self, instance: &Bound<'_, PyAny>, state: &State) -> PyResult<()> {
        let py = instance.py();
        if self.is_own {
            let words = state.read().map_err(refused)?;
            let value = plain::value(py, words)?.into_bound_py_any(py)?;
            instance.call_method1(intern!(py, "restore"), (value,))?;
            return Ok(());
        }
        let numbers: Vec<f64> = state.read().map_err(refused)?;
        self.set_numbers(instance, &numbers)
    }

    /// Returns the named numbers of an instance.
    pub(super) fn numbers(&self, instance: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
        self.rows()?.attributes(instance)
    }

    /// Sets the named numbers of an instance.
    pub(super) fn set_numbers(&self, instance: &Bound<'_, PyAny>, row: &[f64]) -> PyResult<()> {
        let rows = self.rows()?;
        check_count(rows.fields.len(), row.len()).map_err(refused)?;
        rows.set_attributes(instance, row)
    }

    fn rows(&self) -> PyResult<&Rows> {
        let text =
            "the numbers of the state have no names; name them with `state=` in the decorator";
        self.rows
            .as_ref()
            .ok_or_else(|| PyValueError::new_err(text))
    }
}

fn refused(error: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}
