//! Requests to a session and its answers: the words of `hil inject`, with the same checks and the same refusals, and the
//! values of a record.

use std::ffi::OsString;

use clap::Parser;
use hil_console::terminal::exit::Failure;
use hil_facts::arguments::inject::{InjectCommand, InjectLine, arrange};
use hil_facts::session::inject;
use hil_facts::session::live::refused_text;
use hil_run::stepped::signals;
use pyo3::prelude::*;
use shared_types::live::{Possible, Request, Response};

use crate::failure::raised;

/// Returns the request for a fault as JSON, from the words after `hil inject` and the possible faults as JSON.
#[pyfunction]
pub(crate) fn fault_request(words: Vec<String>, possible: &str) -> PyResult<String> {
    request(words, possible).map_err(|failure| raised(&failure))
}

fn request(words: Vec<String>, possible: &str) -> Result<String, Failure> {
    let possible: Possible = serde_json::from_str(possible).map_err(Failure::infrastructure)?;
    let line = ["hil".to_owned(), "inject".to_owned()]
        .into_iter()
        .chain(words);
    let line = InjectLine::try_parse_from(arrange(line.map(OsString::from)));
    let line = line.map_err(|error| Failure::Usage(error.to_string()))?;
    let InjectCommand::Inject(arguments) = line.command;
    let toml = inject::toml(&arguments, &possible);
    let toml = toml.map_err(|problems| Failure::Usage(refused_text(&problems)))?;
    serde_json::to_string(&Request::Inject { toml }).map_err(Failure::infrastructure)
}

/// Name, unit and value of a signal.
type Signal = (String, String, f64);

/// Returns the signals of the answer to a request for the newest record; `None` if it was refused.
#[pyfunction]
pub(crate) fn record_signals(answer: &str) -> PyResult<Option<Vec<Signal>>> {
    let answer = serde_json::from_str(answer).map_err(Failure::infrastructure);
    let Response::Record { layout, words } = answer.map_err(|failure| raised(&failure))? else {
        return Ok(None);
    };
    let values = words.iter().skip(layout.values_start());
    let both = signals(&layout).zip(values);
    let rows = both.map(|((name, unit), bits)| (name, unit.to_owned(), f64::from_bits(*bits)));
    Ok(Some(rows.collect()))
}
