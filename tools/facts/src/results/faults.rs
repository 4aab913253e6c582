//! Fates of a run's faults, for its summary.
//!
//! Derived from the plan and from the plant's events: the requested fault, the step at which it became active, and the
//! size of its effect. A fault without effect is reported as prominently as a fault with an effect.

use std::fmt::Write as _;

use hil_config::plan::{FaultEvent, FaultSource, PLANT_KEYS, Trigger};
use serde::Serialize;
use shared_types::number::short_in;
use shared_types::record::{
    Event, FaultAccepted, FaultBegun, FaultEffectSize, FaultEnded, ValueChange,
};
use shared_types::time::{Rate, Step};

/// Fault events of a run.
#[derive(Clone, Debug, Default)]
pub struct FaultLog {
    /// Accepted live faults.
    pub accepted: Vec<LiveFault>,
    /// Effects that began.
    pub begun: Vec<FaultBegun>,
    /// Effects that ended.
    pub ended: Vec<FaultEnded>,
    /// Sizes of the effects from the plant's final report; `None` if the plant died before it.
    pub sizes: Option<Vec<FaultEffectSize>>,
    /// Keys of parameters whose changes the model does not confirm.
    pub unconfirmed: Vec<String>,
}

/// Accepted live fault.
#[derive(Clone, Debug, PartialEq)]
pub struct LiveFault {
    /// Next step at the time of acceptance.
    pub step: u64,
    /// Accepted event.
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

/// Fault and its fate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Fault {
    event: u32,
    kind: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    source: FaultSource,
    /// Requested time; null for a condition, or for a fault that follows another one.
    requested_at_s: Option<f64>,
    /// Next step when a live fault was accepted.
    #[serde(skip_serializing_if = "Option::is_none")]
    accepted_step: Option<u64>,
    /// Step at which the fault became active; null if it never did.
    effective_step: Option<u64>,
    /// Reason why the fault never became active.
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
    effects: Vec<Effect>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct Effect {
    target: String,
    /// Parameters or signal; null if the fault never became active.
    parameter: Option<String>,
    effective_step: Option<u64>,
    ended_step: Option<u64>,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    cleared: bool,
    /// Largest effect; null, as are the next two, if the plant died before reporting it.
    max_effect: Option<f64>,
    unit: Option<String>,
    acted_steps: Option<u64>,
    /// `true` if the effect became active and changed nothing.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    no_effect: bool,
    /// `true` if the parameter cannot be read back from the model, so that the effect remains unconfirmed.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    unconfirmed: bool,
}

impl FaultLog {
    /// Adds an event if it concerns faults.
    ///
    /// # Errors
    /// If the event of a live fault is malformed; the event is then left out.
    pub fn take(&mut self, event: &Event) -> Result<(), String> {
        match event {
            Event::Accepted(accepted) => {
                let live = LiveFault::try_from(accepted);
                let live = live.map_err(|error| format!("fault {}: {error}", accepted.id))?;
                self.accepted.push(live);
            }
            Event::Fault(begun) => self.begun.push(begun.clone()),
            Event::FaultEnded(ended) => self.ended.push(ended.clone()),
            Event::End(end) => {
                self.sizes = Some(end.effects.clone());
                self.unconfirmed.clone_from(&end.unconfirmed);
            }
            Event::Controller(_) | Event::Change(_) | Event::Mark(_) => {}
        }
        Ok(())
    }

    /// Returns every fault of the run: those of the scenario, then the live ones.
    #[must_use]
    pub fn faults(&self, scenario: &[FaultEvent], rate: Rate) -> Vec<Fault> {
        let planned = scenario.iter().map(|event| self.fault(event, None, rate));
        let live = self.accepted.iter();
        let live = live.map(|live| self.fault(&live.event, Some(live.step), rate));
        planned.chain(live).collect()
    }

    /// Returns the keys of a change that the model does not confirm.
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
        let begun = (self.begun.iter()).find(|begun| (begun.id, begun.effect) == (id, number));
        let ended = (self.ended.iter()).find(|ended| (ended.id, ended.effect) == (id, number));
        let sizes = self.sizes.as_deref().unwrap_or_default();
        let size = sizes
            .iter()
            .find(|size| (size.id, size.effect) == (id, number));
        let reported = size.filter(|size| begun.is_some() || size.step.is_some());
        Effect {
            target: target.into(),
            parameter: (begun.map(|begun| begun.parameter.clone()))
                .or_else(|| reported.map(|size| size.parameter.clone())),
            // In real time the event itself may be lost; the plant's final report contains it too.
            effective_step: (begun.map(|begun| begun.step))
                .or_else(|| size.and_then(|size| size.step)),
            ended_step: ended
                .map(|ended| ended.step)
                .or_else(|| size.and_then(|size| size.ended_step)),
            cleared: ended.is_some_and(|ended| ended.cleared),
            max_effect: size.map(|size| size.max_effect),
            unit: size.map(|size| size.unit.clone()),
            acted_steps: size.map(|size| size.acted_steps),
            no_effect: reported.is_some_and(|size| size.acted_steps == 0),
            unconfirmed: (target.strip_prefix("parameter.")).is_some_and(|name| {
                let key = format!("{PLANT_KEYS}{name}");
                (begun.is_some() || reported.is_some()) && self.unconfirmed.contains(&key)
            }),
        }
    }

    /// Returns the reason why an event never became active.
    fn never(&self, event: &FaultEvent) -> String {
        let is_cleared = |ended: &FaultEnded| ended.id == event.id && ended.cleared;
        if self.ended.iter().any(is_cleared) {
            return "it was cleared earlier".into();
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
                match self.begun.iter().find(|begun| begun.id == *event) {
                    Some(_) => {
                        format!("the run ended within {delay_steps} steps after fault {event}")
                    }
                    None => format!("fault {event}, which it follows, never took effect"),
                }
            }
        }
    }
}

/// Names keys with unconfirmed changes, to follow the description of the change; empty if there are none.
#[must_use]
pub fn not_confirmed(keys: &[String]) -> String {
    match keys {
        [] => String::new(),
        keys => format!(" (not confirmed: {})", keys.join(", ")),
    }
}

impl Fault {
    /// Describes the fault in one or more lines.
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
            (None, Some(reason)) => write!(text, " never took effect: {reason}"),
            (None, None) => write!(text, " never took effect"),
        };
        if self.effective_step.is_none() {
            return text;
        }
        for effect in &self.effects {
            let _ = write!(text, ", {}", effect.target);
            let _ = match (effect.effective_step, effect.max_effect, &effect.unit) {
                (None, ..) => write!(text, " never took effect"),
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
