//! Values of the newest step, copied into memory that an array of numpy shows.

use hil_run::stepped::{Place, SteppedRun};
use pyo3::prelude::*;
use pyo3::types::PyByteArray;

/// Values to copy, and the memory for them.
#[pyclass(frozen, module = "hil._native")]
pub(crate) struct Observer {
    places: Vec<Place>,
    memory: Py<PyByteArray>,
}

impl Observer {
    /// Creates an observer with memory for its values.
    pub(crate) fn new(py: Python<'_>, places: Vec<Place>) -> Self {
        let memory = PyByteArray::new(py, &vec![0; places.len() * size_of::<f64>()]);
        Self {
            places,
            memory: memory.unbind(),
        }
    }

    /// Copies the values of the newest step; NaN before the first.
    pub(crate) fn copy(&self, py: Python<'_>, run: &SteppedRun) {
        let memory = self.memory.bind(py);
        // SAFETY: the interpreter is attached and nothing here calls it, so no other code uses the memory meanwhile.
        let bytes = unsafe { memory.as_bytes_mut() };
        let (chunks, _) = bytes.as_chunks_mut();
        for (chunk, place) in chunks.iter_mut().zip(&self.places) {
            *chunk = run.value(*place).unwrap_or(f64::NAN).to_ne_bytes();
        }
    }
}

#[pymethods]
impl Observer {
    /// Memory of the values: 8 bytes each, in the order of this machine.
    #[getter]
    fn memory(&self, py: Python<'_>) -> Py<PyByteArray> {
        self.memory.clone_ref(py)
    }
}
