//! Exceptions of a plant or a law: the reason of a failure, and the traceback.

use std::cell::RefCell;
use std::sync::atomic::{AtomicBool, Ordering};

use hil_session::program::say;
use pyo3::exceptions::{PyKeyError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use shared_types::describe::Invalid;
use shared_types::failure::Failure;
use shared_types::side::Side;

thread_local! {
    /// Exception of the last failure in this thread, for the session that it ends.
    static LAST: RefCell<Option<PyErr>> = const { RefCell::new(None) };
}
/// `true` in a process that is a side, whose standard error is the log of the run.
static HAS_LOG: AtomicBool = AtomicBool::new(false);
/// `true` in a child that `os.fork` made.
static IS_FORKED: AtomicBool = AtomicBool::new(false);
/// Exit code of such a child.
const FORKED: i32 = 3;

/// Writes tracebacks to standard error from now on.
pub(super) fn begin_log() {
    HAS_LOG.store(true, Ordering::Relaxed);
}

/// Marks this process as a child that `os.fork` made.
pub(super) fn note_fork() {
    IS_FORKED.store(true, Ordering::Relaxed);
}

/// Returns the exception of the last failure in this thread, once.
pub(crate) fn take_exception() -> Option<PyErr> {
    LAST.with_borrow_mut(Option::take)
}

/// Calls a method of a side during a run; an exception becomes the failure.
#[inline]
pub(super) fn during_run<T>(
    side: Side,
    method: &str,
    work: impl FnOnce(Python<'_>) -> PyResult<T>,
) -> Result<T, Failure> {
    Python::attach(|py| {
        let result = work(py);
        if IS_FORKED.load(Ordering::Relaxed) {
            leave(py);
        }
        result.map_err(|error| failure(py, (side, method), error))
    })
}

/// Calls a method before or between steps; an exception becomes the reason of a refusal.
pub(super) fn between_steps<T>(
    method: &str,
    work: impl FnOnce(Python<'_>) -> PyResult<T>,
) -> Result<T, Invalid> {
    Python::attach(|py| work(py).map_err(|error| Invalid(reason(py, method, error))))
}

/// Ends a child of `os.fork` that returned into the loop, which belongs to its parent.
#[cold]
fn leave(py: Python<'_>) {
    say(
        "error: a child process that os.fork made returned from a method of the class; end it with os._exit",
    );
    let os = py
        .import("os")
        .and_then(|os| os.call_method1("_exit", (FORKED,)));
    // Only without a module `os`.
    drop(os);
    std::process::abort();
}

#[cold]
fn failure(py: Python<'_>, (side, method): (Side, &str), error: PyErr) -> Failure {
    let is_divergence = || diverged(py).is_ok_and(|kind| error.is_instance(py, &kind));
    // A law has no range of validity that the run could leave.
    match side == Side::Plant && is_divergence() {
        true => Failure::diverged(error.value(py).to_string()),
        false => Failure::lost(reason(py, method, error)),
    }
}

fn diverged(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    py.import("hil.errors")?.getattr("Diverged")
}

/// Returns an exception of a method as a line, and logs its traceback.
#[cold]
fn reason(py: Python<'_>, method: &str, error: PyErr) -> String {
    if let Some(trace) = error.traceback(py) {
        // Before Python 3.12 the traceback is not yet part of the exception; without it the text lacks only its place.
        let _ = error.value(py).setattr("__traceback__", trace);
    }
    let described = py
        .import("hil.tracebacks")
        .and_then(|module| module.call_method1("describe", (error.value(py),)))
        .and_then(|both| both.extract::<(String, String)>());
    let (mut line, text) = described.unwrap_or_else(|_| (error.to_string(), String::new()));
    // Raised by the caller of the method, on what it returned; only code has a place.
    let named = format!("`{method}`");
    if text.is_empty() && !line.starts_with(&named) {
        line = format!("{named}: {line}");
    }
    if HAS_LOG.load(Ordering::Relaxed) && !text.is_empty() {
        say(text.trim_end());
    }
    let earlier = LAST.replace(Some(error));
    drop(earlier); // which may run code of Python
    line
}

/// Creates the exception of a class that is declared wrongly.
pub(super) fn declaration(py: Python<'_>, message: String) -> PyErr {
    let kind = (py.import("hil.errors")).and_then(|errors| errors.getattr("DeclarationError"));
    match kind.and_then(|kind| kind.call1((&message,))) {
        Ok(error) => PyErr::from_value(error),
        Err(_) => PyTypeError::new_err(message),
    }
}

/// Creates the exception of an unknown name.
pub(super) fn unknown(message: String) -> PyErr {
    // Not a KeyError, which would quote the message.
    PyValueError::new_err(message)
}

/// Creates the exception of a name that a caller looked up.
pub(super) fn missing(message: String) -> PyErr {
    PyKeyError::new_err(message)
}
