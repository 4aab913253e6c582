//! The texts of events, which their plant wrote, made fit to be shown.

use serde_json::Value;
use shared_types::record::{ControllerFate, Event};
use shared_types::text::printable;

/// Most characters of a text of the plant.
const LONGEST_TEXT: usize = 1 << 16;

/// Makes the texts of an event do nothing to a terminal, and no longer than one can read.
#[must_use]
pub fn clean(mut event: Event) -> Event {
    let shown = |text: &mut String| {
        if text.len() > LONGEST_TEXT || printable(text) != *text {
            *text = printable(text).chars().take(LONGEST_TEXT).collect();
        }
    };
    match &mut event {
        Event::Accepted(accepted) => texts(&mut accepted.fault, &shown),
        Event::FaultEnded(_) => {}
        Event::Fault(taken) => {
            for text in [&mut taken.kind, &mut taken.target, &mut taken.parameter] {
                shown(text);
            }
        }
        Event::Controller(change) => match &mut change.change {
            ControllerFate::Lost { reason: text, .. }
            | ControllerFate::Joined { law: text }
            | ControllerFate::Refused { reason: text } => shown(text),
        },
        Event::Mark(mark) => shown(&mut mark.text),
        Event::Change(change) => {
            change.clear.iter_mut().for_each(shown);
            for one in &mut change.set {
                shown(&mut one.key);
                shown(&mut one.unit);
            }
        }
        Event::End(end) => {
            end.reason.iter_mut().for_each(shown);
            for effect in &mut end.effects {
                for text in [
                    &mut effect.kind,
                    &mut effect.target,
                    &mut effect.parameter,
                    &mut effect.unit,
                ] {
                    shown(text);
                }
            }
        }
    }
    event
}

/// Does something to every text of a value.
fn texts(value: &mut Value, shown: &impl Fn(&mut String)) {
    match value {
        Value::String(text) => shown(text),
        Value::Array(all) => all.iter_mut().for_each(|one| texts(one, shown)),
        Value::Object(all) => all.values_mut().for_each(|one| texts(one, shown)),
        Value::Null | Value::Bool(_) | Value::Number(_) => {}
    }
}
