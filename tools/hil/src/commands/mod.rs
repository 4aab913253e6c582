//! Dispatch of each verb to its package, and the verbs without one: config, controller swap, describe, new, recover,
//! runs, sessions, target and completions; also the [guard] of verbs that share memory with programs of others. Called
//! by no other package.

pub(crate) mod completion;
pub(crate) mod config;
pub(crate) mod describe;
mod fitting;
mod guard;
pub(crate) mod new;
pub(crate) mod recover;
pub(crate) mod runs;
pub(crate) mod sessions;
pub(crate) mod swap;
pub(crate) mod target;

use std::process::ExitCode;

use hil_campaign::command as campaign;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::{advice, interruption, output};
use hil_facts::session::{clock, inject, mark, set};
use hil_operating_point::{linearise, trim};
use hil_session::session;
use hil_verification::arguments::recordings::ScenarioAction;
use hil_verification::{baseline, compare, judge, margins, repetition, replay, rerun, suite};
use hil_views::{export, layout, monitor, panel, report, values};
use shared_types::live::Request;

use crate::arguments::swap::ControllerAction;
use crate::arguments::{Command, CommandLine};

/// Executes the command line of this process and reports failures.
#[must_use]
pub fn main() -> ExitCode {
    hil_facts::programs::own::note_commit(env!("HIL_COMMIT"));
    if completion::answered() {
        return ExitCode::SUCCESS;
    }
    let command_line = CommandLine::of_process();
    if guard::is_needed(&command_line.command) && !guard::is_there() {
        return guard::run(&command_line.command);
    }
    match interruption::end_at_once().and_then(|()| execute(&command_line)) {
        Ok(exit) => exit.into(),
        Err(failure) => {
            let message = failure.to_string();
            output::tell(&message);
            if let Some(advice) = advice::on(&message) {
                output::tell(&format!("  = help: {advice}"));
            }
            failure.exit().into()
        }
    }
}

/// Executes a command line.
///
/// # Errors
/// The failure of the command, with its exit code.
fn execute(command_line: &CommandLine) -> Result<Exit, Failure> {
    // Every command removes the remains of dead sessions; `sessions` also reports them. The peer of a measurement
    // is part of a live session.
    if !matches!(
        command_line.command,
        Command::Sessions(_) | Command::LatencyPeer(_)
    ) {
        let _ = session::sweep(); // creating a session reports the error
    }
    fitting::refuse_other_kinds(&command_line.command)?;
    match &command_line.command {
        Command::Run(arguments) => panel::with_run(arguments, suite::run),
        Command::Inject(arguments) => inject::inject(arguments),
        Command::Pause(arguments) => clock::clock(&arguments.session, &Request::Pause),
        Command::Resume(arguments) => clock::clock(&arguments.session, &Request::Resume),
        Command::Step(arguments) => {
            let request = Request::Advance {
                steps: arguments.steps,
            };
            clock::clock(&arguments.session, &request)
        }
        Command::Get(arguments) => values::get(arguments),
        Command::Watch(arguments) => values::watch(arguments),
        Command::Set(arguments) => set::set(arguments),
        Command::Mark(arguments) => mark::mark(arguments),
        Command::Monitor(arguments) => monitor::monitor(arguments),
        Command::Panel(arguments) => panel::panel(arguments),
        Command::Controller(arguments) => match &arguments.action {
            ControllerAction::Swap(arguments) => swap::swap(arguments),
        },
        Command::Margins(arguments) => margins::margins(arguments),
        Command::Campaign(arguments) => campaign::campaign(&arguments.action),
        Command::Search(arguments) => campaign::search(&arguments.action),
        Command::Rerun(arguments) => rerun::rerun(arguments),
        Command::Replay(arguments) => replay::replay(arguments),
        Command::Compare(arguments) => match &arguments.baseline {
            Some(name) => baseline::command(arguments, name),
            None => compare::command(arguments),
        },
        Command::Judge(arguments) => judge::judge(arguments),
        Command::Report(arguments) => match arguments
            .runs
            .iter()
            .any(|path| campaign::is_campaign(path))
        {
            true => campaign::report(arguments),
            false => report::report(arguments),
        },
        Command::Export(arguments) => export::export(arguments),
        Command::Layout(arguments) => layout::layout(arguments),
        Command::Recover(arguments) => recover::recover(arguments),
        Command::New(arguments) => new::new(arguments),
        Command::Runs(arguments) => runs::runs(arguments),
        Command::Scenario(arguments) => match &arguments.action {
            ScenarioAction::From(arguments) => repetition::scenario_from(arguments),
        },
        Command::Describe(arguments) => describe::describe(arguments),
        Command::Config(arguments) => config::config(arguments),
        Command::Linearise(arguments) => linearise::linearise(arguments),
        Command::Trim(arguments) => trim::trim(arguments),
        Command::Sessions(arguments) => sessions::sessions(arguments),
        Command::Target(arguments) => target::target(&arguments.action),
        Command::Doctor(arguments) => hil_doctor::doctor(arguments),
        Command::Latency(arguments) => hil_benchmark::latency(arguments),
        Command::LatencyPeer(arguments) => hil_benchmark::peer::peer(arguments),
        Command::Completions { shell } => {
            output::write(&completion::script(*shell))?;
            Ok(Exit::Pass)
        }
    }
}
