//! Plants and laws that are Python classes.
//!
//! 1. The decorators of `hil/declare.py` check a class and attach its declaration.
//! 2. [`plant_kind`] and [`law_kind`] read it: `tables` has the columns, `saving` the state. They become a `PlantKind`
//!    or a `LawKind` with the checks that the compiler makes for Rust.
//! 3. At each step a row of numbers becomes an instance of its dataclass, and the returned instance a row.
//! 4. An exception ends the run with its reason: `failure`.
//! 5. [`program`] is the process of a side; a caller that runs sides in its own process needs only the kinds.
//!
//! Each call attaches to the interpreter and detaches after it, so other threads of the process can run in between.

mod arguments;
mod failure;
mod law;
mod mathematics;
mod plain;
mod plant;
mod program;
mod saving;
mod tables;

use pyo3::prelude::*;

pub(crate) use failure::take_exception;
pub(crate) use law::law_kind;
pub(crate) use plant::plant_kind;

/// Adds what is here to the module.
pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<arguments::Interval>()?;
    module.add_class::<arguments::Setup>()?;
    module.add_class::<arguments::Sample>()?;
    program::register(module)?;
    mathematics::register(module)
}

/// Reads the declaration of a class that must be of a kind, `plant` or `law`.
fn declaration<'py>(class: &Bound<'py, PyAny>, kind: &str) -> PyResult<Bound<'py, PyAny>> {
    let py = class.py();
    let side = py
        .import("hil.declare")?
        .call_method1("side_of", (class,))?;
    let actual: String = side.getattr("kind")?.extract()?;
    if actual != kind {
        let name: String = side.getattr("name")?.extract()?;
        return Err(failure::declaration(
            py,
            format!("`{name}` is a {actual}, not a {kind}"),
        ));
    }
    Ok(side)
}
