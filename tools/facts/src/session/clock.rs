//! `hil pause`, `hil resume` and `hil step`: the clock of a running session.

use hil_console::terminal::exit::{Exit, Failure};
use shared_types::live::{Request, Response, Status};

use crate::arguments::SessionChoice;
use crate::session::live;

/// Sends a request whose response is the run's status, and prints the response.
///
/// # Errors
/// If there is no session to ask, or the session does not respond.
pub fn clock(choice: &SessionChoice, request: &Request) -> Result<Exit, Failure> {
    live::tell_answer(choice, request, |answer| match answer {
        Response::Status(status) => Some(format!("{}\n", describe(status))),
        _ => None,
    })
}

/// Describes the position of a run.
#[must_use]
pub fn describe(status: &Status) -> String {
    let Status {
        step,
        time_s,
        steps,
        paused,
    } = status;
    let state = if *paused {
        "paused before"
    } else {
        "running at"
    };
    format!("{state} step {step} of {steps} ({time_s} s)")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_status_states_whether_the_run_is_paused() {
        let status = |paused| Status {
            step: 70_000,
            time_s: 7.0,
            steps: 200_000,
            paused,
        };
        assert_eq!(
            describe(&status(true)),
            "paused before step 70000 of 200000 (7 s)"
        );
        assert_eq!(
            describe(&status(false)),
            "running at step 70000 of 200000 (7 s)"
        );
    }
}
