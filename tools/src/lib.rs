//! `hil`: run, judge and inspect hardware-in-the-loop sessions.
//!
//! A run, from the command line to the summary:
//!
//! 1. [`cli`] is what was typed.
//! 2. [`binaries`] finds plant and controller, by what the command line, the scenario or a recording
//!    names, and asks them what they are; the scenario is checked against that.
//! 3. [`run`] prepares session and folder, starts both sides and watches over them.
//! 4. [`recorder`] drains the record stream on a thread of its own: digest, metrics, latency,
//!    [`recording`].
//! 5. [`summary`] says how it went, to a person and to a machine, and what became of the [`faults`].
//!
//! While it runs, another terminal asks its plant over [`live`]: [`inject`] puts faults into it,
//! [`clock`] holds it and lets it go on; [`swap`] asks its `hil` for another controller; [`monitor`] shows it by an
//! [`observer`] of its records and by where its requirements [stand](standing). Afterwards [`run_reader`] reads the recording: [`compare`]
//! finds where two runs differ, [`repetition`] makes the scenario that repeats one, live faults
//! included, and [`rerun`] runs that; [`judge`] evaluates metrics and [`requirements`] once more, or
//! others; [`replay`] gives what was recorded to a controller once more, [`baseline`] keeps named runs to
//! compare with; [`report`] makes a page of runs to look at; [`export`] makes a table of a run for other programs, [`layout`] says what these are to plot; [`recover`] makes a whole recording of
//! one that broke off.
//!
//! A [`checkpoint`] keeps the state of both sides before a step, for another run to go on from.
//!
//! `succession` tells what became of controllers, `suite` makes one verdict table of several runs, `audit` repeats a run under conditions that must not matter, `missed` finds what came too late in
//! a recorded one.
//!
//! [`doctor`] judges the machine that it all runs on, [`latency`] measures the loop on it. [`config`]
//! and [`sessions`] are the commands around it, [`folder`] is where a run is written, `part_file` how a file appears whole or not at all, `reserve` the room
//! for the end of a run, `open_files` looks that there may be enough of them, [`duration`] how times are typed, [`output`] and [`interruption`] are its ways to and from the
//! terminal. Nothing here runs on the loop but the plant and law of [`latency`] that do
//! nothing, and the plant's place that [`replay`] takes.

use std::io::IsTerminal;

// First, because its macro `tell!` is used everywhere.
#[macro_use]
pub mod output;

mod account;
pub mod advice;
mod audit;
pub mod baseline;
pub mod binaries;
pub mod change;
pub mod checked;
pub mod checkpoint;
pub mod cli;
pub mod clock;
pub mod compare;
pub mod config;
mod destination;
pub mod doctor;
pub mod duration;
pub mod ended;
pub mod ending;
pub mod evaluation;
pub mod exit;
pub mod export;
pub mod faults;
pub mod folder;
pub mod inject;
pub mod interruption;
pub mod judge;
pub mod latency;
pub mod layout;
pub mod live;
mod missed;
pub mod monitor;
pub mod names;
pub mod observer;
mod open_files;
mod part_file;
pub mod progress;
pub mod recorded;
pub mod recorder;
pub mod recording;
pub mod recover;
pub mod repetition;
pub mod replay;
pub mod report;
pub mod requirements;
pub mod rerun;
mod reserve;
pub mod resumed;
#[cfg(test)]
mod rig;
pub mod run;
pub mod run_reader;
pub mod scenario;
pub mod sessions;
pub mod settings;
pub mod standing;
mod succession;
mod suite;
pub mod summary;
pub mod swap;
mod validity;

use cli::recordings::ScenarioAction;
use cli::swap::ControllerAction;
use cli::{Command, CommandLine};
use exit::{Exit, Failure};
use shared_types::live::Request;
use shared_types::session;

/// Does what the command line says.
///
/// # Errors
/// Everything that keeps it from that, with its exit code.
pub fn execute(command_line: &CommandLine) -> Result<Exit, Failure> {
    // What a dead one left, every command removes; `sessions` tells of it. The peer of a measurement
    // is part of a live one.
    if !matches!(
        command_line.command,
        Command::Sessions(_) | Command::LatencyPeer(_)
    ) {
        let _ = session::sweep(); // who creates a session hears of what is wrong
    }
    match &command_line.command {
        Command::Run(arguments) => run::run(arguments),
        Command::Inject(arguments) => inject::inject(arguments),
        Command::Pause(arguments) => clock::clock(&arguments.session, &Request::Pause),
        Command::Resume(arguments) => clock::clock(&arguments.session, &Request::Resume),
        Command::Step(arguments) => {
            let request = Request::Advance {
                steps: arguments.steps,
            };
            clock::clock(&arguments.session, &request)
        }
        Command::Monitor(arguments) => monitor::monitor(arguments),
        Command::Controller(arguments) => match &arguments.action {
            ControllerAction::Swap(arguments) => change::swap(arguments),
        },
        Command::Rerun(arguments) => rerun::rerun(arguments),
        Command::Replay(arguments) => replay::replay(arguments),
        Command::Compare(arguments) => compare::command(arguments),
        Command::Judge(arguments) => judge::judge(arguments),
        Command::Report(arguments) => report::report(arguments),
        Command::Export(arguments) => export::export(arguments),
        Command::Layout(arguments) => layout::layout(arguments),
        Command::Recover(arguments) => recover::recover(arguments),
        Command::Scenario(arguments) => match &arguments.action {
            ScenarioAction::From(arguments) => repetition::scenario_from(arguments),
        },
        Command::Config(arguments) => config::config(arguments),
        Command::Sessions(arguments) => sessions::sessions(arguments),
        Command::Doctor(arguments) => doctor::doctor(arguments),
        Command::Latency(arguments) => latency::latency(arguments),
        Command::LatencyPeer(arguments) => latency::peer::peer(arguments),
        Command::Completions { shell } => {
            output::write(&cli::completions(*shell))?;
            Ok(Exit::Pass)
        }
    }
}

/// Whether a person reads standard error as it comes.
fn person_watches() -> bool {
    std::io::stderr().is_terminal()
}
