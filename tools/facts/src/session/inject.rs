//! `hil inject`: faults in a running session.
//!
//! The words become the text of a request. The plant checks the request like a fault of a scenario and answers with the
//! step at which the fault takes effect. A listing shows the possible faults.

mod listing;
mod request;
mod typed;

use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
pub use listing::{ListedKind, kinds_of};
pub use request::toml;

use std::fmt::Write as _;

use hil_session::session::SessionInfo;
use shared_types::live::{FaultState, Injected, Possible, Request, Response, Status};
use shared_types::number::short_in;

use crate::arguments::inject::{Clear, InjectArguments};
use crate::session::clock;
use crate::session::live::{self, RequestError};

/// State of a fault that has ended.
const ENDED: &str = "ended";

/// Runs the command.
///
/// # Errors
/// If the request is refused, or there is no session to accept it.
pub fn inject(arguments: &InjectArguments) -> Result<Exit, Failure> {
    let json = arguments.session.json;
    let answer = if arguments.list {
        listing::list(arguments)
    } else {
        live::find(&arguments.session)
            .and_then(|session| answer(arguments, &session))
            .and_then(|response| {
                if json {
                    Ok(live::to_json(&response)?)
                } else {
                    describe(&response)
                }
            })
    };
    output::write(&answer.map_err(|error| error.tell(json))?)?;
    Ok(Exit::Pass)
}

fn answer(arguments: &InjectArguments, session: &SessionInfo) -> Result<Response, RequestError> {
    let request = if arguments.active {
        Request::Active
    } else if let Some(clear) = arguments.clear {
        Request::Clear {
            id: match clear {
                Clear::All => None,
                Clear::One(id) => Some(id),
            },
        }
    } else {
        let possible = possible(session)?;
        Request::Inject {
            toml: request::toml(arguments, &possible).map_err(RequestError::Refused)?,
        }
    };
    let response =
        live::ask(session, &request).map_err(|error| typed::as_typed(error, arguments))?;
    Ok(match response {
        // The plant reports all faults of the run.
        Response::Active { status, mut faults } => {
            faults.retain(|fault| fault.state != ENDED);
            Response::Active { status, faults }
        }
        other => other,
    })
}

/// Queries the faults that a session supports.
pub fn possible(session: &SessionInfo) -> Result<Possible, RequestError> {
    match live::ask(session, &Request::Possible)? {
        Response::Possible(possible) => Ok(*possible),
        other => Err(live::unexpected(&other)),
    }
}

/// Lists every kind of fault that a session supports, with targets and values, as JSON.
pub fn listed(possible: &Possible) -> serde_json::Value {
    listing::of(possible)
}

/// Formats an answer for the user.
pub fn describe(response: &Response) -> Result<String, RequestError> {
    let mut text = String::new();
    match response {
        Response::Injected { faults } => faults.iter().for_each(|fault| text += &injected(fault)),
        Response::Cleared { ids, .. } if ids.is_empty() => text += "no fault to end\n",
        Response::Cleared { ids, step } => {
            for id in ids {
                // Writing to a string cannot fail.
                let _ = writeln!(text, "fault {id} ends: step {step} is the first without it");
            }
        }
        Response::Active { status, faults } => text += &active(status, faults),
        other => return Err(live::unexpected(other)),
    }
    Ok(text)
}

fn injected(fault: &Injected) -> String {
    let Injected {
        id,
        kind,
        effective_step,
        effective_at_s,
        waits_for,
    } = fault;
    match (effective_step, effective_at_s) {
        (Some(step), Some(at_s)) => {
            format!("fault {id} {kind} takes effect at step {step} ({at_s} s)\n")
        }
        (Some(step), None) => format!("fault {id} {kind} takes effect at step {step}\n"),
        (None, _) => {
            let waits_for = waits_for.as_deref().unwrap_or("its trigger");
            format!("fault {id} {kind} waits for {waits_for}\n")
        }
    }
}

fn active(status: &Status, faults: &[FaultState]) -> String {
    let mut text = format!("{}\n", clock::describe(status));
    if faults.is_empty() {
        text += "no active or waiting faults\n";
    }
    for fault in faults {
        let FaultState {
            id,
            kind,
            source,
            state,
            waits_for,
            effects,
        } = fault;
        let waits_for = waits_for
            .as_ref()
            .map_or(String::new(), |what| format!(" for {what}"));
        // Writing to a string cannot fail.
        let _ = writeln!(text, "fault {id} {kind} ({source}): {state}{waits_for}");
        for effect in effects {
            let (target, size, unit) = (&effect.target, effect.max_effect, &effect.unit);
            let since = effect
                .step
                .map_or(String::new(), |step| format!(" since step {step}"));
            let until = effect
                .ended_step
                .map_or(String::new(), |step| format!(" until step {step}"));
            let _ = match effect.step {
                Some(_) => writeln!(
                    text,
                    "  {target}{since}{until}: at most {}, acted at {} steps",
                    short_in(size, unit),
                    effect.acted_steps
                ),
                None => writeln!(text, "  {target}"),
            };
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use shared_types::record::FaultEffectSize;

    use super::*;

    #[test]
    fn an_answer_names_the_step_at_which_a_fault_takes_hold() {
        let fault = |id, effective_step: Option<u64>, waits_for: Option<&str>| Injected {
            id,
            kind: "bias".into(),
            effective_step,
            effective_at_s: effective_step.map(|step| step as f64 / 1e4),
            waits_for: waits_for.map(Into::into),
        };
        let answer = Response::Injected {
            faults: vec![
                fault(3, Some(12_345), None),
                fault(4, None, Some("`truth.x_m > 1`")),
            ],
        };
        let expected = "\
fault 3 bias takes effect at step 12345 (1.2345 s)
fault 4 bias waits for `truth.x_m > 1`
";
        assert_eq!(describe(&answer).expect("an answer"), expected);
        let cleared = |ids| describe(&Response::Cleared { ids, step: 7 }).expect("an answer");
        assert_eq!(cleared(vec![]), "no fault to end\n");
        assert_eq!(
            cleared(vec![2]),
            "fault 2 ends: step 7 is the first without it\n"
        );
    }

    #[test]
    fn active_faults_show_state_and_size() {
        let effect = |step| FaultEffectSize {
            id: 1,
            effect: 0,
            kind: "bias".into(),
            target: "measured.x_m".into(),
            parameter: "x_m".into(),
            step,
            ended_step: None,
            acted_steps: 9,
            max_effect: 0.25,
            unit: "m".into(),
        };
        let state = |id, state: &str, waits_for: Option<&str>, step| FaultState {
            id,
            kind: "bias".into(),
            source: "cli".into(),
            state: state.into(),
            waits_for: waits_for.map(Into::into),
            effects: vec![effect(step)],
        };
        let status = Status {
            step: 10,
            time_s: 0.1,
            steps: 100,
            paused: true,
        };
        let faults = [
            state(1, "active", None, Some(1)),
            state(2, "waiting", Some("step 50"), None),
        ];
        let expected = "\
paused before step 10 of 100 (0.1 s)
fault 1 bias (cli): active
  measured.x_m since step 1: at most 0.25 m, acted at 9 steps
fault 2 bias (cli): waiting for step 50
  measured.x_m
";
        assert_eq!(active(&status, &faults), expected);
        assert!(active(&status, &[]).ends_with("no active or waiting faults\n"));
    }
}
