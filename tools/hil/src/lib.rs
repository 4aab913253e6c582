//! `hil`: run, judge and inspect hardware-in-the-loop sessions.
//!
//! The top of a house of packages. Each imports only packages below it, which the compiler holds and a test repeats;
//! the README of each says what it is for, who calls it and what it never does.
//!
//! | Package | What lives there |
//! |---|---|
//! | `hil`: [`commands`] | verbs without a package of their own, and which verb goes where |
//! | `hil`: [`arguments`] | the command line as it is typed |
//! | [`hil_campaign`] | very many cases of one scenario, on cores and clusters |
//! | [`hil_views`] | monitor, panel, get and watch, report, export, layout, and the chooser of their plots |
//! | [`hil_verification`] | compare, baselines, judge, replay, rerun, audit, suite: is it the same, is it right? |
//! | [`hil_benchmark`] | what `hil latency` measures |
//! | [`hil_run`] | one run: processes, recorder, real-time settings, controllers that come and go |
//! | [`hil_doctor`] | the machine that it all runs on |
//! | [`hil_facts`] | programs and scenario, results, checkpoints, a session from another terminal |
//! | [`hil_console`] | exit codes and failures, output, tables, progress, whole files, the folder of a run |
//!
//! A run, from the command line to the summary:
//!
//! 1. [`arguments`] is what was typed, and `commands::execute` finds the verb's package; for `hil run` it is
//!    [`hil_verification::suite`], where one scenario is a suite of one. [`hil_views::panel`] starts it, with a page if
//!    asked.
//! 2. [`hil_facts::programs`] finds plant and controller and asks them what they are; the scenario is checked against
//!    that.
//! 3. [`hil_run`] prepares session and folder, starts both sides and watches over them.
//! 4. Its [recorder](hil_run::recorder) drains the record stream on a thread of its own: digest, metrics,
//!    requirements, latency, [recording](hil_recording).
//! 5. Its end makes the exit code: [`hil_facts::results::requirements`] turns the verdict into one,
//!    [`hil_verification::suite`] takes the worst of several, and [`hil_console::terminal::exit`] lists them all.
//!    [`hil_facts::results::summary`] says how it went, to a person and to a machine.
//!
//! A subcommand is added in these places: its arguments in `arguments` of the package that owns it, its variant of
//! `Command` and its name in `GROUPS` in `arguments/mod.rs` here; its work in that package or else in [`commands`]; its
//! line in `commands::execute`. Then `HIL_WRITE_BOOK=1 cargo test --release -p tests book::references` writes the
//! reference of the book.
//!
//! Packages beside these: recordings, [`hil_recording`] (`tools/recording`); the controller on another machine, its
//! agent and the programs that it may run, [`hil_target`] (`tools/remote`); both sides of a run in one thread,
//! `hil-in-process` (`tools/in-process`); C programs and FMUs, `hil-foreign` (`tools/foreign`), which is never linked
//! into `hil`.
//!
//! Packages below: [`hil_config`] checks scenarios and live requests, `plant-process` and `controller-process` are the
//! loop, [`shared_types`] has links, records, their digest and the conformance suites. Three parts of `hil` run on the
//! loop: the idle plant and law of [`hil_benchmark`], the [replay](hil_verification::replay) in the plant's place, and
//! `hil-in-process`.

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
