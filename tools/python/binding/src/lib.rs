//! Native part of the Python package `hil`, loaded as `hil._native`.
//!
//! 1. `scenario` reads and checks a scenario as the command line does.
//! 2. `session` holds its run in this process and executes it step by step; `observer` copies values of the newest
//!    step into memory of Python, and `saved` is the state before a step.
//! 3. `request` turns the words of `hil inject` into the request of a session, and reads the answer with a record.
//! 4. `side` makes plants and laws of Python classes, and is the process of such a side; `class` reads each class
//!    once for all sessions that have it.
//! 5. `evaluation` runs a scenario at many points, and `columns` copies signals of a recording, on all cores by
//!    `parallel`.
//! 6. `agent` chooses the commands of a session in place of a law, and `environment` executes the steps between its
//!    choices.
//!
//! `bound` keeps what is not made for several threads in the thread that made it, and `failure` turns the failures
//! of `hil` into the exceptions of `hil.errors`. A session installs no signal handler, and starts neither thread nor
//! process.

mod agent;
mod bound;
mod class;
mod columns;
mod environment;
mod evaluation;
mod failure;
mod observer;
mod parallel;
mod request;
mod saved;
mod scenario;
mod session;
mod side;

use pyo3::pymodule;

/// Native part of the package `hil`.
#[pymodule]
mod _native {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::agent::Agent;
    #[pymodule_export]
    use crate::columns::read_columns;
    #[pymodule_export]
    use crate::environment::play;
    #[pymodule_export]
    use crate::evaluation::evaluate_points;
    #[pymodule_export]
    use crate::observer::Observer;
    #[pymodule_export]
    use crate::request::{fault_request, record_signals};
    #[pymodule_export]
    use crate::saved::Saved;
    #[pymodule_export]
    use crate::session::{Session, open_session};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add("MOST_CHANGES", shared_types::record::MOST_CHANGES)?;
        crate::side::register(module)
    }
}
