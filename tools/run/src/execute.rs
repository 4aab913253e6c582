//! Execution of a checked scenario, from preparation to summary.
//!
//! Called by every command that runs a scenario. Judges nothing, and does not know other runs.

use hil_config::plan::Plan;
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_facts::arguments::run::{LinkKind, RunOptions};
use hil_facts::results::company::ProcessorTime;

use super::conclude::conclude;
use super::environment::{Environment, Origin, RunResult};
use super::prepare::prepare;
use super::settings::Settings;
use super::{in_process, manual_start, processes, realtime};

/// Checks the options and begins to listen for signals.
///
/// # Errors
/// If options contradict each other.
pub fn begin(options: &RunOptions) -> Result<(Settings, Interruption), Failure> {
    Ok((Settings::of(options)?, Interruption::listen()?))
}

/// Executes a checked scenario, optionally to repeat a recorded run or to continue from a checkpoint.
///
/// # Errors
/// If the run could not be started.
pub fn execute(plan: Plan, environment: Environment, origin: Origin) -> Result<RunResult, Failure> {
    let (prepared, mut session) = prepare(plan, environment, origin)?;
    let by_hand = match manual_start::admit(&prepared, &mut session) {
        Ok(by_hand) => by_hand,
        Err(failure) => {
            prepared.leave_nothing();
            return Err(failure);
        }
    };
    let (link, before) = (prepared.settings.link, ProcessorTime::now());
    let mut realtime = realtime::Watched::begin(prepared.plan.realtime, link, &prepared.session);
    let ended = match link {
        LinkKind::Iceoryx2 => processes::run(&prepared, &mut session, by_hand, &mut realtime)?,
        LinkKind::InProcess => in_process::run(&prepared, &mut realtime)?,
    };
    conclude(prepared, session, realtime.end(), ended, &before)
}
