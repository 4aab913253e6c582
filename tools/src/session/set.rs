//! `hil set`: values of a running session changed, all at one step.

use std::fmt::Write as _;

use shared_types::live::{ChangeRequest, Changed, NewValue, Request, Response};
use shared_types::number::exact_in;

use crate::arguments::set::SetArguments;
use crate::session::live;
use crate::terminal::exit::{Exit, Failure};
use crate::terminal::output;

/// Changes values, and tells at which step.
///
/// # Errors
/// If there is no session to ask, or it refuses the change.
pub(crate) fn set(arguments: &SetArguments) -> Result<Exit, Failure> {
    let new = |(key, value): &(String, f64)| NewValue {
        key: key.clone(),
        value: *value,
    };
    let request = Request::Set(ChangeRequest {
        set: arguments.set.iter().map(new).collect(),
        clear: arguments.clear.clone(),
        at_s: arguments.at,
        ramp_s: arguments.ramp,
    });
    let json = arguments.session.json;
    let answer =
        live::find(&arguments.session).and_then(|session| match live::ask(&session, &request)? {
            Response::Changed(changed) => Ok(changed),
            other => Err(live::unexpected(&other)),
        });
    let changed = answer.map_err(|error| error.tell(json))?;
    output::write(&match json {
        true => live::to_json(&Response::Changed(changed))?,
        false => describe(&changed),
    })?;
    Ok(Exit::Pass)
}

/// Describes a change that was taken, with a line for each value.
#[must_use]
pub(crate) fn describe(changed: &Changed) -> String {
    let Changed {
        id,
        step,
        at_s,
        ramp_steps,
        set,
        clear,
    } = changed;
    let mut text = format!("change {id} at step {step} ({at_s} s)");
    if *ramp_steps > 0 {
        // Writing to a string cannot fail.
        let _ = write!(text, ", over {ramp_steps} steps");
    }
    text.push('\n');
    for one in set {
        let _ = writeln!(text, "  {} = {}", one.key, exact_in(one.value, &one.unit));
    }
    for key in clear {
        let _ = writeln!(text, "  {key} follows its stimulus");
    }
    text
}
