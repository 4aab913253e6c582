//! `hil mark`: a note at a step of a running session.

use hil_console::terminal::exit::{Exit, Failure};
use shared_types::live::{Request, Response};

use crate::arguments::mark::MarkArguments;
use crate::session::live;

/// Sets a mark before the session's next step, and prints the step.
///
/// # Errors
/// If there is no session, or the session refuses the mark.
pub fn mark(arguments: &MarkArguments) -> Result<Exit, Failure> {
    let request = Request::Mark {
        text: arguments.text.clone(),
    };
    live::tell_answer(&arguments.session, &request, |answer| match answer {
        Response::Marked { step, at_s } => Some(format!("marked step {step} ({at_s} s)\n")),
        _ => None,
    })
}
