//! `hil`: run, judge and inspect hardware-in-the-loop sessions.
//!
//! The top package. Each package imports only packages below it, which the compiler enforces and a test repeats;
//! the README of each states its purpose, its callers and its limits.
//!
//! | Package | Contents |
//! |---|---|
//! | `hil`: [`commands`] | dispatch of verbs, and verbs without a package of their own |
//! | `hil`: [`arguments`] | the command line |
//! | [`hil_campaign`] | very many cases of one scenario, on cores and clusters |
//! | [`hil_views`] | monitor, panel, get and watch, report, export, layout, and the selection of their plots |
//! | [`hil_verification`] | compare, baselines, judge, replay, rerun, audit, suite: correctness and reproducibility
//! |
//! | [`hil_operating_point`] | trim and linearise: equilibria and linear models of plants, laws and loops |
//! | [`hil_benchmark`] | the measurements of `hil latency` |
//! | [`hil_run`] | one run: processes, recorder, real-time settings, controller swaps |
//! | [`hil_doctor`] | checks of the machine |
//! | [`hil_facts`] | programs and scenario, results, checkpoints, requests to a session from another terminal |
//! | [`hil_console`] | exit codes and failures, output, tables, progress, atomic files, the folder of a run |
//!
//! A run, from the command line to the summary:
//!
//! 1. [`arguments`] parses the command line, and `commands::execute` dispatches to the verb's package; for `hil run` it
//!    is [`hil_verification::suite`], where one scenario is a suite of one. [`hil_views::panel`] starts the run if a
//!    page is requested.
//! 2. [`hil_facts::programs`] finds plant and controller and reads their descriptions; the scenario is checked
//!    against those.
//! 3. [`hil_run`] prepares session and folder, starts both sides and supervises them.
//! 4. Its [recorder](hil_run::recorder) drains the record stream on a thread of its own: digest, metrics,
//!    requirements, latency, [recording](hil_recording).
//! 5. The end of the run determines the exit code: `conclude` of [`hil_run`] gives a run its code,
//!    [`hil_facts::results::requirements`] converts the verdict, [`hil_verification::suite`] takes the worst of
//!    several, and [`hil_console::terminal::exit`] lists all codes.
//!    [`hil_facts::results::summary`] reports the results, as text and as JSON.
//!
//! To add a subcommand, add: its arguments to `arguments` of the package that owns it; its variant to `Command` and
//! its name to `GROUPS` in `arguments/mod.rs` here; its work to that package or else to [`commands`]; its line to
//! `commands::execute`. Then `HIL_WRITE_BOOK=1 cargo test --release -p tests book::references` writes the reference
//! of the book.
//!
//! Other packages: [`hil_recording`] (`tools/recording`) for recordings; [`hil_target`] (`tools/remote`) for
//! the controller on another machine, its agent and the programs that it may run; `hil-in-process`
//! (`tools/in-process`) for both sides of a run in one thread; `hil-foreign` (`tools/foreign`) for C programs and
//! FMUs, which is never linked into `hil`.
//!
//! Packages below: [`hil_config`] checks scenarios and live requests, `plant-process` and `controller-process` form
//! the loop, [`shared_types`] has links, records, their digest and the conformance suites. Three parts of `hil`
//! take part in the loop: the idle plant and law of [`hil_benchmark`], the [replay](hil_verification::replay) in
//! the plant's place, and `hil-in-process`.

#![expect(
    rustdoc::private_intra_doc_links,
    reason = "the map leads into modules that are closed to other packages"
)]

#[macro_use]
extern crate hil_console; // its macro `tell!` is used everywhere

mod arguments;
mod commands;

#[cfg(test)]
#[path = "../../recording/tests/shared/fixture.rs"]
#[expect(dead_code, reason = "these tests need a part of it")]
mod fixture;

pub use arguments::{Command, CommandLine};
pub use commands::main;
