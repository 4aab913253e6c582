//! Fates of the faults of a run, for its summary.
//!
//! Made from the plan and from the events that the plant published: what was asked for, the step at
//! which it took hold, how large its effect was. A fault that did nothing is told as loudly as one
//! that did.

use std::fmt::Write as _;

use hil_config::plan::{FaultEvent, FaultSource, PLANT_KEYS, Trigger};
use serde::Serialize;
use shared_types::number::short_in;
use shared_types::record::{
    Event, FaultAccepted, FaultBegun, FaultEffectSize, FaultEnded, ValueChange,
};
use shared_types::time::{Rate, Step};

/// The events of a run that are about faults.
#[derive(Clone, Debug, Default)]
pub struct FaultLog {
    /// Live faults that were accepted.
    pub accepted: Vec<LiveFault>,
    /// Effects that took hold.
    pub taken: Vec<FaultBegun>,
    /// Effects that ended.
    pub ended: Vec<FaultEnded>,
    /// Sizes of the effects, by the plant's last word; `None` if the plant died before.
    pub sizes: Option<Vec<FaultEffectSize>>,
    /// Keys of parameters whose changes the model does not confirm.
    pub unconfirmed: Vec<String>,
}

/// A live fault that was accepted.
#[derive(Clone, Debug, PartialEq)]
pub struct LiveFault {
    /// The next step when it was accepted.
    pub step: u64,
    /// Event that was accepted.
    pub event: FaultEvent,
}

impl TryFrom<&FaultAccepted> for LiveFault {
    type Error = serde_json::Error;

    fn try_from(accepted: &FaultAccepted) -> Result<Self, Self::Error> {
        Ok(Self {
            step: accepted.step,
            event: serde_json::from_value(accepted.fault.clone())?,
        })
    }
}

/// A fault and what became of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Fault {
    event: u32,
    kind: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    source: FaultSource,
    /// Null if no time was asked for: a condition, or after another fault.
    requested_at_s: Option<f64>,
    /// The next step when a live fault was accepted.
    #[serde(skip_serializing_if = "Option::is_none")]
    accepted_step: Option<u64>,
    /// Null if it never took hold.
    effective_step: Option<u64>,
    /// Reason for which the fault never took hold.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
    effects: Vec<Effect>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct Effect {
    target: String,
    /// Parameters or signal; null if it never took hold.
    parameter: Option<String>,
    effective_step: Option<u64>,
    ended_step: Option<u64>,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    cleared: bool,
    /// Null if the plant died before it could tell, as are the next two.
    max_effect: Option<f64>,
    unit: Option<String>,
    acted_steps: Option<u64>,
    /// The effect took hold and changed nothing.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    no_effect: bool,
    /// The parameter cannot be read back from the model: nothing confirms the effect.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    unconfirmed: bool,
}

impl FaultLog {
    /// Takes an event, if it is about faults.
    ///
    /// # Errors
    /// If the event of a live fault cannot be understood, which is then left out.
    pub fn take(&mut self, event: &Event) -> Result<(), String> {
        match event {
            Event::Accepted(accepted) => {
                let live = LiveFault::try_from(accepted);
                let live = live.map_err(|error| format!("fault {}: {error}", accepted.id))?;
                self.accepted.push(live);
            }
            Event::Fault(taken) => self.taken.push(taken.clone()),
            Event::FaultEnded(ended) => self.ended.push(ended.clone()),
            Event::End(end) => {
                self.sizes = Some(end.effects.clone());
                self.unconfirmed.clone_from(&end.unconfirmed);
            }
            Event::Controller(_) | Event::Change(_) | Event::Mark(_) => {}
        }
        Ok(())
    }

    /// Every fault of the run: those of the scenario, then the live ones.
    #[must_use]
    pub fn faults(&self, scenario: &[FaultEvent], rate: Rate) -> Vec<Fault> {
        let planned = scenario.iter().map(|event| self.fault(event, None, rate));
        let live = self.accepted.iter();
        let live = live.map(|live| self.fault(&live.event, Some(live.step), rate));
        planned.chain(live).collect()
    }

    /// Keys of a change that the model does not confirm.
    #[must_use]
    pub fn unconfirmed_of(&self, change: &ValueChange) -> Vec<String> {
        let keys = change.set.iter().map(|one| &one.key);
        keys.filter(|key| self.unconfirmed.contains(key))
            .cloned()
            .collect()
    }

    fn fault(&self, event: &FaultEvent, accepted_step: Option<u64>, rate: Rate) -> Fault {
        let effects: Vec<Effect> = (0..)
            .zip(&event.effects)
            .map(|(number, effect)| self.effect(event.id, number, &effect.target))
            .collect();
        let effective_step = effects
            .iter()
            .filter_map(|effect| effect.effective_step)
            .min();
        let is_never = effective_step.is_none();
        Fault {
            event: event.id,
            kind: event.kind.clone(),
            name: event.name.clone(),
            source: event.source,
            requested_at_s: match event.trigger {
                Trigger::Step { at_s, .. } => Some(at_s),
                Trigger::Now => accepted_step.map(|step| rate.seconds(Step(step))),
                Trigger::Condition(_) | Trigger::After { .. } => None,
            },
            accepted_step,
            effective_step,
            reason: is_never.then(|| self.never(event)),
            effects,
        }
    }

    fn effect(&self, id: u32, number: u32, target: &str) -> Effect {
        let taken = (self.taken.iter()).find(|taken| (taken.id, taken.effect) == (id, number));
        let ended = (self.ended.iter()).find(|ended| (ended.id, ended.effect) == (id, number));
        let sizes = self.sizes.as_deref().unwrap_or_default();
        let size = sizes
            .iter()
            .find(|size| (size.id, size.effect) == (id, number));
        let held = size.filter(|size| taken.is_some() || size.step.is_some());
        Effect {
            target: target.into(),
            parameter: (taken.map(|taken| taken.parameter.clone()))
                .or_else(|| held.map(|size| size.parameter.clone())),
            // In real time the event itself may be lost; the plant's last word has it too.
            effective_step: (taken.map(|taken| taken.step))
                .or_else(|| size.and_then(|size| size.step)),
            ended_step: ended
                .map(|ended| ended.step)
                .or_else(|| size.and_then(|size| size.ended_step)),
            cleared: ended.is_some_and(|ended| ended.cleared),
            max_effect: size.map(|size| size.max_effect),
            unit: size.map(|size| size.unit.clone()),
            acted_steps: size.map(|size| size.acted_steps),
            no_effect: held.is_some_and(|size| size.acted_steps == 0),
            unconfirmed: (target.strip_prefix("parameter.")).is_some_and(|name| {
                let key = format!("{PLANT_KEYS}{name}");
                (taken.is_some() || held.is_some()) && self.unconfirmed.contains(&key)
            }),
        }
    }

    /// Returns the reason for which an event never took hold.
    fn never(&self, event: &FaultEvent) -> String {
        let is_cleared = |ended: &FaultEnded| ended.id == event.id && ended.cleared;
        if self.ended.iter().any(is_cleared) {
            return "it was cleared before".into();
        }
        match &event.trigger {
            Trigger::Step { step, .. } => format!("the run ended before step {step}"),
            Trigger::Now => "the run ended before the next step".into(),
            Trigger::Condition(condition) => {
                let text = &condition.expression;
                match condition.records {
                    0 | 1 => format!("`{text}` never held"),
                    records => format!("`{text}` never held for {records} steps in a row"),
                }
            }
            Trigger::After { event, delay_steps } => {
                match self.taken.iter().find(|taken| taken.id == *event) {
                    Some(_) => {
                        format!("the run ended within {delay_steps} steps after fault {event}")
                    }
                    None => format!("fault {event}, which it follows, never took hold"),
                }
            }
        }
    }
}

/// Names keys whose change is not confirmed, to follow the description of the change; empty without one.
#[must_use]
pub fn not_confirmed(keys: &[String]) -> String {
    match keys {
        [] => String::new(),
        keys => format!(" (not confirmed: {})", keys.join(", ")),
    }
}

impl Fault {
    /// The fault as a person reads it, in a line or more.
    #[must_use]
    pub fn describe(&self) -> String {
        let live = match self.source {
            FaultSource::Scenario => "",
            FaultSource::Cli => " (live)",
        };
        let (event, kind) = (self.event, &self.kind);
        let name = self
            .name
            .iter()
            .fold(String::new(), |_, name| format!(" `{name}`"));
        let mut text = format!("fault {event} {kind}{name}{live}");
        // Writing to a string cannot fail.
        let _ = match (self.effective_step, &self.reason) {
            (Some(step), _) => write!(text, " at step {step}"),
            (None, Some(reason)) => write!(text, " never took hold: {reason}"),
            (None, None) => write!(text, " never took hold"),
        };
        if self.effective_step.is_none() {
            return text;
        }
        for effect in &self.effects {
            let _ = write!(text, ", {}", effect.target);
            let _ = match (effect.effective_step, effect.max_effect, &effect.unit) {
                (None, ..) => write!(text, " never took hold"),
                (_, Some(_), _) if effect.no_effect => write!(text, " NO EFFECT"),
                (_, Some(size), Some(unit)) => write!(text, " {}", short_in(size, unit)),
                _ => write!(text, " of unknown size"),
            };
            if effect.unconfirmed {
                text.push_str(" (not confirmed)");
            }
            if let Some(step) = effect.ended_step {
                let how = if effect.cleared { "cleared" } else { "ended" };
                let _ = write!(text, " ({how} at step {step})");
            }
        }
        text
    }
}

#[cfg(test)]
mod tests;
