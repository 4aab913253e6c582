//! State of a session before a step, as an object of Python.

use hil_run::stepped::SavedRun;
use pyo3::prelude::*;

use crate::bound::Bound;

/// State of a session before a step, with the results of all earlier steps. It is memory of this process.
#[pyclass(frozen, module = "hil._native")]
pub(crate) struct Saved {
    pub(crate) run: Bound<SavedRun>,
    step: u64,
}

impl Saved {
    /// Wraps a saved run.
    pub(crate) fn new(run: SavedRun) -> Self {
        Self {
            step: run.step().0,
            run: Bound::new(run),
        }
    }
}

#[pymethods]
impl Saved {
    /// Step before which the session was saved.
    #[getter]
    const fn step_index(&self) -> u64 {
        self.step
    }

    fn __repr__(&self) -> String {
        format!("<hil.Saved before step {}>", self.step)
    }
}
