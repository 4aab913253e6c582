//! Measurement of the loop and of the machine's limits, with a plant and a law that do nothing. No scenario is run
//! here; the figures are defined in [`results`](hil_facts::results::latency).
//!
//! `hil latency` measures the machine:
//!
//! 1. [`measurement`] runs a [null] plant and law through the real engine, link and runner. The plant is a thread of
//!    this process; the controller is a [`peer`], a second `hil` process.
//! 2. Between the same two sides, the measurement also determines the [`raw`] limit of shared memory and the bare
//!    [blackboard](hil_session::link::bare), an [`exchange`] of payloads as large as the loop's frames.
//! 3. The [`report`] puts all cases side by side, with the bars of one of them.
//!
//! `hil latency RUN` reports the same figures for a [`recorded`] run.

#![expect(
    rustdoc::private_intra_doc_links,
    reason = "the map leads into modules that are closed to other packages"
)]

#[macro_use]
extern crate hil_console; // its macro `tell!` is used everywhere

pub mod arguments;
pub mod exchange;
pub(crate) mod measurement;
pub mod null;
pub mod peer;
pub mod raw;
pub mod recorded;
pub(crate) mod report;

use std::path::Path;

use crate::arguments::LatencyArguments;

use hil_console::files::part_file;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use report::Report;

/// Runs the command.
///
/// # Errors
/// If no measurement is possible, the run cannot be read, or the results cannot be written.
pub fn latency(arguments: &LatencyArguments) -> Result<Exit, Failure> {
    if let Some(csv) = &arguments.csv {
        check_folder_of(csv)?;
    }
    let cases = match &arguments.run {
        Some(run) => vec![recorded::case(run, arguments.warm_up.unwrap_or(0))?],
        None => measurement::matrix(arguments)?,
    };
    let report = Report::new(&cases, arguments.run.as_deref());
    if let Some(csv) = &arguments.csv {
        part_file::write_text(csv, &report::csv(&cases))?;
    }
    output::result(arguments.json, &report, || report.text(&cases))?;
    Ok(Exit::Pass)
}

/// Refuses an output file whose folder does not exist, before a minute of measuring.
fn check_folder_of(file: &Path) -> Result<(), Failure> {
    let absolute = std::path::absolute(file).map_err(Failure::usage)?;
    match absolute.parent() {
        Some(folder) if folder.is_dir() && !file.is_dir() => Ok(()),
        _ => Err(Failure::usage(format!(
            "cannot write {}: its folder does not exist, or it is itself a folder",
            file.display()
        ))),
    }
}
