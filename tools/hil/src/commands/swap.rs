//! `hil controller swap`: requests another controller from the `hil` that runs a session.

use std::path::PathBuf;
use std::time::Duration;

use hil_console::files::folder;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_facts::programs::binaries::named::refuse_set;
use hil_facts::session::live::{RequestError, find, to_json};
use hil_run::swap::{Request, Response, SOCKET, Swapped};
use hil_session::live::{LiveError, ask_at};
use shared_types::live::Refusal;

use crate::arguments::swap::SwapArguments;

/// Time limit for `hil` to answer, in addition to that of the new controller, because a stopped process never answers.
const ANSWER_LIMIT: Duration = Duration::from_secs(120);
/// Number of parts of a swap that may each take the wait limit: description, check and start.
const PARTS: f64 = 3.0;

/// Runs the command.
///
/// # Errors
/// If there is no session, or the session refuses.
pub(crate) fn swap(arguments: &SwapArguments) -> Result<Exit, Failure> {
    let json = arguments.session.json;
    let swapped = ask(arguments).map_err(|error| error.tell(json))?;
    output::write(&if json {
        to_json(&Response::Swapped(swapped))?
    } else {
        let Swapped {
            epoch,
            step,
            law,
            binary,
            left_out,
        } = swapped;
        let binary = binary.display();
        let mut text = format!("controller {epoch} ({law}, {binary}) took over at step {step}\n");
        if !left_out.is_empty() {
            let keys = left_out.join(", ");
            text += &format!("  left out, because none of its laws has them: {keys}\n");
        }
        text
    })?;
    Ok(Exit::Pass)
}

fn ask(arguments: &SwapArguments) -> Result<Swapped, RequestError> {
    refuse_set(&arguments.set, |role| match role.side {
        "controller" => "--bin",
        _ => role.flag,
    })?;
    let session = find(&arguments.session)?;
    let absolute = |path: &PathBuf| std::path::absolute(path).map_err(Failure::usage);
    let binary = arguments.bin.as_ref().map(absolute).transpose()?;
    binary.as_deref().map_or(Ok(()), folder::refuse_odd)?;
    let request = Request {
        binary,
        set: arguments.set.clone(),
        wait_limit_s: arguments.wait_limit,
    };
    let parts_s = PARTS * arguments.wait_limit.unwrap_or_default();
    let parts = Duration::try_from_secs_f64(parts_s);
    // Without a limit: some 100 years.
    let parts = parts.unwrap_or(Duration::from_secs(u32::MAX.into()));
    match ask_at(&session, SOCKET, &request, ANSWER_LIMIT.saturating_add(parts)) {
        Ok(Response::Swapped(swapped)) => Ok(swapped),
        Ok(Response::Refused { reason }) => Err(Refusal::new(reason).into()),
        Err(LiveError::Absent(name)) => Err(Refusal::new(format!(
            "session `{name}` has no controller process to swap: it is starting, has ended, or runs in one process"
        ))
        .into()),
        Err(error) => Err(Failure::infrastructure(error).into()),
    }
}
