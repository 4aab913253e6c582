//! Native part of the Python package `hil`, loaded as `hil._native`.
//!
//! [`side`] makes plants and laws of Python classes, and is the process of such a side.

mod side;

use pyo3::pymodule;

/// Native part of the package `hil`.
#[pymodule]
mod _native {
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        crate::side::register(module)
    }
}
