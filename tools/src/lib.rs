//! `hil`: run, judge and inspect hardware-in-the-loop sessions.
//!
//! A house of rooms. Each imports only rooms below it, which a test holds; the first paragraph of each says what
//! lives in it and what never does.
//!
//! | Room | What lives there |
//! |---|---|
//! | [`commands`] | verbs without a room of their own, and which verb goes where |
//! | [`hil_campaign`] | very many cases of one scenario, on cores and clusters |
//! | [`hil_views`] | monitor, panel, get and watch, report, export, layout, and the chooser of their plots |
//! | [`hil_verification`] | compare, baselines, judge, replay, rerun, audit, suite: is it the same, is it right? |
//! | [`hil_benchmark`] | what `hil latency` measures |
//! | [`hil_run`] | one run: processes, recorder, real-time settings, controllers that come and go |
//! | [`hil_doctor`] | the machine that it all runs on |
//! | [`arguments`] | the command line as it is typed |
//!
//! A run, from the command line to the summary:
//!
//! 1. [`arguments`] is what was typed, and `commands::execute` finds the verb's room; for `hil run` it is
//!    `verification::suite`, where one scenario is a suite of one. `views::panel` starts it, with a page if asked.
//! 2. [`hil_facts::programs`] finds plant and controller and asks them what they are; the scenario is checked against that.
//! 3. [`hil_run`] prepares session and folder, starts both sides and watches over them.
//! 4. Its [recorder](hil_run::recorder) drains the record stream on a thread of its own: digest, metrics,
//!    requirements, latency, [recording](hil_recording).
//! 5. `run::conclude` makes the exit code: [`hil_facts::results::requirements`] turns the verdict into one,
//!    `verification::suite` takes the worst of several, and [`hil_console::terminal::exit`] lists them all.
//!    [`hil_facts::results::summary`] says how it went, to a person and to a machine.
//!
//! A subcommand is added in these places: its arguments in a file of [`arguments`], its variant of `Command` and
//! its name in `GROUPS` in `arguments/mod.rs`; its work in the room that owns it or else in [`commands`]; its line
//! in `commands::execute`. Then `HIL_WRITE_BOOK=1 cargo test --release -p tests book::references` writes the reference
//! of the book.
//!
//! Packages beside the rooms: terminal and files, [`hil_console`] (`tools/console`); programs, results
//! and sessions, [`hil_facts`] (`tools/facts`); recordings, [`hil_recording`] (`tools/recording`); draws, folders, tables and statistics
//! of campaigns, [`hil_campaign`] (`tools/campaign`); the controller on another machine, its agent and the programs
//! that it may run, [`hil_target`] (`tools/remote`); both sides of a run in one thread, [`hil_in_process`]
//! (`tools/in-process`); C programs and FMUs, `hil-foreign` (`tools/foreign`), which is never linked into `hil`.
//!
//! Packages below: [`hil_config`] checks scenarios and live requests, [`plant_process`] and [`controller_process`]
//! are the loop, [`shared_types`] has links, records, their digest and the conformance suites. Three parts of `hil`
//! run on the loop: the idle plant and law of [`hil_benchmark`], the [replay](hil_verification::replay) in the plant's
//! place, and [`hil_in_process`].

#![expect(
    rustdoc::private_intra_doc_links,
    reason = "the map leads into rooms that are closed to other packages"
)]

#[macro_use]
extern crate hil_console; // its macro `tell!` is used everywhere

mod arguments;
mod commands;

#[cfg(test)]
#[path = "../recording/tests/shared/fixture.rs"]
#[expect(dead_code, reason = "these tests need a part of it")]
mod fixture;

pub use commands::main;

/// Parts that tests, benchmarks and fuzz targets of this workspace use. Nothing else of `tools` is public, so
/// that the compiler sees what nobody uses.
pub mod testing {
    pub use crate::arguments::{Command, CommandLine};
    pub use hil_benchmark::exchange::{End, Trips, follow, lead};
    pub use hil_benchmark::null::NullPlant;
    pub use hil_benchmark::{raw, recorded};
    pub use hil_console::terminal::interruption::Interruption;
    pub use hil_doctor::measure::gaps;
    pub use hil_facts::arguments::inject::arrange;
    pub use hil_facts::checkpoint::Checkpoint;
    pub use hil_facts::results::company::ProcessorTime;
    pub use hil_facts::results::faults::LiveFault;
    pub use hil_facts::results::latency::grade::UNFIT_NS;
    pub use hil_facts::results::latency::legs::Latency;
    pub use hil_facts::session::inject;
    pub use hil_run::recorder::{Recorder, RecordingPlan};
    pub use hil_verification::arguments::tolerance::Tolerances;
    pub use hil_verification::compare::{Verdict, compare};
    pub use hil_verification::judge::judged;
    pub use hil_verification::repetition::RecordedScenario;
    pub use hil_views::arguments::export::{ExportArguments, ExportFormat};
    pub use hil_views::export;
    pub use hil_views::monitor::terminal::Screen;
    pub use hil_views::panel::message as panel_message;
    pub use hil_views::panel::request as panel_request;
}
