//! `hil set`: changes values of a running session, all at one step.

use std::fmt::Write as _;

use hil_console::terminal::exit::{Exit, Failure};
use shared_types::live::{ChangeRequest, Changed, NewValue, Request, Response};
use shared_types::number::exact_in;

use crate::arguments::set::SetArguments;
use crate::session::live;

/// Changes values, and prints the step of the change.
///
/// # Errors
/// If there is no session, or the session refuses the change.
pub fn set(arguments: &SetArguments) -> Result<Exit, Failure> {
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
    live::tell_answer(&arguments.session, &request, |answer| match answer {
        Response::Changed(changed) => Some(describe(changed)),
        _ => None,
    })
}

/// Describes an accepted change, with a line for each value.
#[must_use]
pub fn describe(changed: &Changed) -> String {
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
