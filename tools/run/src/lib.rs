//! A run from checked scenario to summary: its processes or its thread, the recorder, the real-time settings, and
//! controller changes. Decides nothing about several runs, and compares nothing.
//!
//! 1. [`settings`] checks the options from the command line.
//! 2. [`execute`](execute()) calls `prepare`: refusals, session, folder with its long `tables`, [jobs], [provenance].
//! 3. `processes` or `in_process` runs both sides, with the [recorder] attached to their stream. Both end a run whose
//!    recorder failed, for example on a full disk, and `processes` ends a run whose side died. `controllers` restarts a
//!    lost controller or lets its loss end the run, and `termination` states why the run ended; the policies `hold` and
//!    `safe-command` are implemented by the plant, in `plant_process::engine`. Before that, `manual_start` waits for
//!    sides that are started by hand.
//! 4. `conclude` makes checkpoints, summary and exit code from the result; `restoration` checks each checkpoint with
//!    second sides.
//!
//! Meanwhile `attach` connects the recorder to the stream, [`swap`] starts another controller, `objections` has the
//! programs judge changed parameters, `pause` reports that a run is paused, and `log` limits the size of logs.
//! [`realtime`] applies the settings of `hil` itself, and [`open_files`] ensures a sufficient limit of open files.
//!
//! For large numbers of runs, [`alone`] executes a run in one thread with neither session nor folder, and [`kept`]
//! reuses the processes of one run for the next. [`stepped`] holds a run in this thread before any step.

#![expect(
    rustdoc::private_intra_doc_links,
    reason = "the map leads into modules that are closed to other packages"
)]

#[macro_use]
extern crate hil_console; // its macro `tell!` is used everywhere

pub mod alone;
mod attach;
mod conclude;
mod controllers;
mod environment;
pub mod execute;
mod in_process;
pub mod jobs;
pub mod kept;
mod log;
mod manual_start;
mod objections;
pub mod open_files;
mod pause;
mod prepare;
mod prepared;
pub mod processes;
mod provenance;
pub mod realtime;
pub mod recorder;
mod restoration;
pub mod settings;
pub mod side;
pub mod stepped;
pub mod swap;
mod tables;
mod termination;

#[cfg(test)]
#[path = "../../recording/tests/shared/fixture.rs"]
#[expect(dead_code, reason = "these tests need a part of it")]
mod fixture;
#[cfg(test)]
#[path = "../../facts/tests/shared/rig.rs"]
#[expect(dead_code, reason = "these tests need a part of it")]
mod rig;

pub use environment::{Environment, Origin, Repeated, RunResult};
pub use execute::{begin, execute};
