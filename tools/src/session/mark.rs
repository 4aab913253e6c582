//! `hil mark`: a note at a step of a running session.

use shared_types::live::{Request, Response};

use crate::arguments::mark::MarkArguments;
use crate::session::live;
use crate::terminal::exit::{Exit, Failure};
use crate::terminal::output;

/// Puts a note before the session's next step, and tells which that was.
///
/// # Errors
/// If there is no session to ask, or it refuses the note.
pub(crate) fn mark(arguments: &MarkArguments) -> Result<Exit, Failure> {
    let request = Request::Mark {
        text: arguments.text.clone(),
    };
    let json = arguments.session.json;
    let answer =
        live::find(&arguments.session).and_then(|session| match live::ask(&session, &request)? {
            marked @ Response::Marked { .. } => Ok(marked),
            other => Err(live::unexpected(&other)),
        });
    let answer = answer.map_err(|error| error.tell(json))?;
    output::write(&match &answer {
        Response::Marked { step, at_s } if !json => format!("marked step {step} ({at_s} s)\n"),
        _ => live::to_json(&answer)?,
    })?;
    Ok(Exit::Pass)
}
