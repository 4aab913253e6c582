//! Account of a session: every reported event of its run, once and in order.
//!
//! The recorder, which loses no event, records each one, and the `hil` that runs the session sends the account to
//! clients that [ask](super::standing) for it: an observer receives only the events after it joined.

use serde::{Deserialize, Serialize};
use shared_types::record::{ControllerFate, Event};
use shared_types::time::{Rate, Step};

/// Event of a run as reported to the user.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Happening {
    /// Step of the event.
    pub step: u64,
    /// The event in one line, with its step.
    pub text: String,
    /// Label in a plot; `None` for faults, which are shaded there, and for changes without effect on values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
    /// Key of a change of a single value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub key: Option<String>,
}

impl Happening {
    /// Describes an event; `None` for a fault that is not active yet, and for the end of the run.
    #[must_use]
    pub fn of(event: &Event, rate: Rate) -> Option<Self> {
        let at = |step: u64| format!("step {step} ({} s)", rate.seconds(Step(step)));
        let (step, text, label, key) = match event {
            Event::Fault(fault) => {
                let (id, kind, target) = (fault.id, &fault.kind, &fault.target);
                let text = format!("fault {id} {kind} on {target} from {}", at(fault.step));
                (fault.step, text, None, None)
            }
            Event::FaultEnded(ended) => {
                let (id, effect) = (ended.id, ended.effect + 1);
                let how = if ended.cleared { "cleared" } else { "ended" };
                let text = format!("fault {id} effect {effect} {how} at {}", at(ended.step));
                (ended.step, text, None, None)
            }
            Event::Controller(change) => {
                let (epoch, step) = (change.epoch, change.step);
                match &change.change {
                    ControllerFate::Lost { reason, .. } => {
                        let text = format!("controller {epoch} lost at {}: {reason}", at(step));
                        (step, text, None, None)
                    }
                    ControllerFate::Joined { law } => {
                        let name = format!("controller {epoch} ({law})");
                        let text = format!("{name} from {}", at(step));
                        (step, text, (epoch > 1).then_some(name), None)
                    }
                    ControllerFate::Refused { reason } => {
                        let text = format!("controller {epoch} refused at {}: {reason}", at(step));
                        (step, text, None, None)
                    }
                }
            }
            Event::Change(change) => {
                let description = change.described();
                let text = format!("changed at {}: {description}", at(change.step));
                let is_of_one = change.set.len() == 1 && change.clear.is_empty();
                let key = is_of_one.then(|| change.set[0].key.clone());
                (change.step, text, Some(description), key)
            }
            Event::Mark(mark) => {
                let text = format!("mark at {}: {}", at(mark.step), mark.text);
                (mark.step, text, Some(mark.text.clone()), None)
            }
            Event::Accepted(_) | Event::End(_) => return None,
        };
        Some(Self {
            step,
            text,
            label,
            key,
        })
    }
}
