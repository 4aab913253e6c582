//! Failures of `hil` as the exceptions of `hil.errors`.

use hil_config::problem::Problems;
use hil_console::terminal::exit::Failure;
use pyo3::prelude::*;

/// Words of the command in an exception.
const COMMAND: [&str; 1] = ["hil.Session"];

/// Creates the exception of a failure.
pub(crate) fn raised(failure: &Failure) -> PyErr {
    command_error(failure.exit() as i32, failure.to_string(), "[]".into())
}

/// Creates the exception of a scenario with problems.
pub(crate) fn refused(problems: &Problems) -> PyErr {
    let json = serde_json::to_string(problems).unwrap_or_else(|_| "[]".into());
    command_error(2, problems.to_string(), json)
}

/// Creates the exception of an exit code, with the text of the command line and the problems as JSON.
fn command_error(exit_code: i32, text: String, problems: String) -> PyErr {
    Python::attach(|py| {
        let made = || -> PyResult<PyErr> {
            let errors = py.import("hil.errors")?;
            let problems = py.import("json")?.call_method1("loads", (problems,))?;
            let kind = errors.call_method1("of_exit_code", (exit_code,))?;
            let error = kind.call1((COMMAND.to_vec(), exit_code, text, problems))?;
            Ok(PyErr::from_value(error))
        };
        made().unwrap_or_else(|error| error)
    })
}

/// Creates the exception of a session that cannot be used in this way.
pub(crate) fn session_error(text: &str) -> PyErr {
    Python::attach(|py| {
        let made = || -> PyResult<PyErr> {
            let kind = py.import("hil.errors")?.getattr("SessionError")?;
            Ok(PyErr::from_value(kind.call1((text,))?))
        };
        made().unwrap_or_else(|error| error)
    })
}
