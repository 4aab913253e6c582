//! Sanitising of event texts, which come from the plant, before they are displayed.

use serde_json::Value;
use shared_types::record::{ControllerFate, Event};
use shared_types::text::printable;

/// Maximum length of a text from the plant, in characters.
const LONGEST_TEXT: usize = 1 << 16;

/// Escapes control characters in the texts of an event, and truncates them to a readable length.
#[must_use]
pub fn clean(mut event: Event) -> Event {
    let sanitise = |text: &mut String| {
        if text.len() > LONGEST_TEXT || printable(text) != *text {
            *text = printable(text).chars().take(LONGEST_TEXT).collect();
        }
    };
    match &mut event {
        Event::Accepted(accepted) => texts(&mut accepted.fault, &sanitise),
        Event::FaultEnded(_) => {}
        Event::Fault(fault) => {
            for text in [&mut fault.kind, &mut fault.target, &mut fault.parameter] {
                sanitise(text);
            }
        }
        Event::Controller(change) => match &mut change.change {
            ControllerFate::Lost { reason: text, .. }
            | ControllerFate::Joined { law: text }
            | ControllerFate::Refused { reason: text } => sanitise(text),
        },
        Event::Mark(mark) => sanitise(&mut mark.text),
        Event::Change(change) => {
            change.clear.iter_mut().for_each(sanitise);
            for one in &mut change.set {
                sanitise(&mut one.key);
                sanitise(&mut one.unit);
            }
        }
        Event::End(end) => {
            end.reason.iter_mut().for_each(sanitise);
            for counts in &mut end.bus {
                sanitise(&mut counts.frame);
                sanitise(&mut counts.carries);
                for saturated in &mut counts.saturated {
                    sanitise(&mut saturated.signal);
                }
            }
            for effect in &mut end.effects {
                for text in [
                    &mut effect.kind,
                    &mut effect.target,
                    &mut effect.parameter,
                    &mut effect.unit,
                ] {
                    sanitise(text);
                }
            }
        }
    }
    event
}

/// Applies a function to every text of a value.
fn texts(value: &mut Value, sanitise: &impl Fn(&mut String)) {
    match value {
        Value::String(text) => sanitise(text),
        Value::Array(all) => all.iter_mut().for_each(|one| texts(one, sanitise)),
        Value::Object(all) => all.values_mut().for_each(|one| texts(one, sanitise)),
        Value::Null | Value::Bool(_) | Value::Number(_) => {}
    }
}
