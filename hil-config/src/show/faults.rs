//! Fault events as `[[faults]]`.
//!
//! Times are written in seconds if they convert back to the same step, otherwise in steps.

use std::fmt::Write;

use shared_types::describe::{
    FaultDescription, FaultKindDescription, PlantDescription, ProfileDescription, Settings,
};
use shared_types::table::Field;
use shared_types::time::{Rate, Step};

use super::{
    Failure, ShowError, Written, array, comment, entries, inline, key, list, string, undescribed,
};
use crate::check::unit_of;
use crate::plan::{Condition, FaultAction, FaultEffect, FaultEnd, FaultEvent, Profile, Trigger};
use crate::quantity::toml_float;

/// Context in which events are shown.
pub(super) struct Look<'a> {
    /// Plant.
    pub plant: &'a PlantDescription,
    /// Fault kinds other than the plant's own.
    pub kinds: &'a [FaultKindDescription],
    /// Steps per second.
    pub rate: Rate,
    /// Events to which `after` may refer by name.
    pub others: &'a [FaultEvent],
}

impl<'a> Look<'a> {
    pub(super) fn event(&self, text: &mut String, event: &FaultEvent) -> Written {
        let own = self.plant.faults.iter().find(|own| own.kind == event.kind);
        let kind = self.kinds.iter().find(|kind| kind.kind == event.kind);
        let summary = match (own, kind) {
            (Some(own), _) => &own.summary,
            (None, Some(kind)) => &kind.summary,
            (None, None) => return Err(self.undescribed(&event.kind)),
        };
        writeln!(text, "\n[[faults]] # {}", comment(summary))?;
        if let Some(name) = &event.name {
            writeln!(text, "name = {}", string(name))?;
        }
        writeln!(text, "kind = {}", string(&event.kind))?;
        self.trigger(text, event)?;
        self.end(text, &event.end)?;
        for effect in &event.effects {
            match effect_step(event, effect) {
                Some(step) => writeln!(text, "[[faults.effects]] # of step {step}")?,
                None => writeln!(text, "[[faults.effects]]")?,
            }
            match &effect.action {
                FaultAction::Move { sizes, .. } => {
                    let own = own.ok_or_else(|| self.undescribed(&event.kind))?;
                    moves(text, effect, own, sizes)?;
                }
                FaultAction::Kind { parameters, list } => {
                    let kind = kind.ok_or_else(|| self.undescribed(&event.kind))?;
                    self.kind(text, effect, kind, parameters, list)?;
                }
            }
            self.skew(text, event, effect)?;
        }
        Ok(())
    }

    fn undescribed(&self, kind: &str) -> Failure {
        undescribed(format!("fault `{kind}` of plant `{}`", self.plant.name))
    }

    fn trigger(&self, text: &mut String, event: &FaultEvent) -> Written {
        match &event.trigger {
            Trigger::Step { step, at_s } if self.leads_to(*at_s, *step) => {
                writeln!(text, "at_s = {}", toml_float(*at_s))?;
            }
            Trigger::Step { step, .. } => writeln!(text, "at_step = {step}")?,
            Trigger::Now => return Err(Failure::Show(ShowError::Now(event.id))),
            Trigger::Condition(condition) => self.condition(text, condition, "when", "for_s")?,
            Trigger::After { event, delay_steps } => {
                let other = self.others.iter().find(|other| other.id == *event);
                match other.and_then(|other| other.name.as_ref()) {
                    Some(name) => writeln!(text, "after = {}", string(name))?,
                    None => writeln!(text, "after = {event}")?,
                }
                self.steps(text, "delay_s", *delay_steps)?;
            }
        }
        Ok(())
    }

    fn leads_to(&self, time_s: f64, step: Step) -> bool {
        self.rate.step_at_or_after(time_s) == step
    }

    fn end(&self, text: &mut String, end: &FaultEnd) -> Written {
        if let Some(steps) = end.after_steps {
            self.steps(text, "duration_s", steps)?;
        }
        if let Some(step) = end.step {
            self.steps(text, "end_s", step.0)?;
        }
        if let Some(count) = end.occurrences {
            writeln!(text, "occurrences = {count}")?;
        }
        if let Some(condition) = &end.condition {
            self.condition(text, condition, "until", "until_for_s")?;
        }
        Ok(())
    }

    fn condition(
        &self,
        text: &mut String,
        condition: &Condition,
        key: &str,
        length_key: &str,
    ) -> Written {
        writeln!(text, "{key} = {}", string(&condition.expression))?;
        match condition.records {
            1 => Ok(()), // as it is without the key
            records => self.steps(text, length_key, records),
        }
    }

    /// Writes a number of steps as a time that reads back as the same number.
    fn steps(&self, text: &mut String, key: &str, steps: u64) -> Written {
        let time_s = toml_float(self.rate.seconds(Step(steps)));
        let unit = if steps == 1 { "step" } else { "steps" };
        Ok(writeln!(text, "{key} = {time_s} # {steps} {unit}")?)
    }

    fn skew(&self, text: &mut String, event: &FaultEvent, effect: &FaultEffect) -> Written {
        let steps = effect.skew_steps;
        if steps == 0 {
            return Ok(());
        }
        let skew_s = self.rate.seconds(Step(steps));
        let exact = match event.trigger {
            // Counts from the requested time, which may lie before the step.
            Trigger::Step { step, at_s } if self.leads_to(at_s, step) => {
                self.leads_to(at_s + skew_s, Step(step.0 + steps))
            }
            _ => true,
        };
        if exact {
            writeln!(text, "skew_s = {}", toml_float(skew_s))?;
        } else {
            writeln!(text, "skew_steps = {steps}")?;
        }
        Ok(())
    }

    fn kind(
        &self,
        text: &mut String,
        effect: &FaultEffect,
        kind: &FaultKindDescription,
        parameters: &Settings,
        rows: &[f64],
    ) -> Written {
        writeln!(text, "target = {}", string(&effect.target))?;
        settings(text, parameters, &kind.parameters)?;
        if !rows.is_empty() {
            let described = (kind.list.as_ref())
                .ok_or_else(|| undescribed(format!("the list of fault `{}`", kind.kind)))?;
            let name = key(&described.key);
            if described.columns == 1 {
                writeln!(text, "{name} = {}", list(rows))?;
            } else {
                let rows = rows.chunks(described.columns).map(list);
                writeln!(text, "{name} = {}", array(rows))?;
            }
        }
        if effect.profile != Profile::Step {
            writeln!(text, "profile = {}", inline(entries(&effect.profile)))?;
        }
        Ok(())
    }
}

/// Returns the step of an effect, if known.
fn effect_step(event: &FaultEvent, effect: &FaultEffect) -> Option<Step> {
    match event.trigger {
        Trigger::Step { step, .. } => Some(Step(step.0 + effect.skew_steps)),
        _ => None,
    }
}

/// Writes an effect of a plant fault.
fn moves(
    text: &mut String,
    effect: &FaultEffect,
    own: &FaultDescription,
    sizes: &Settings,
) -> Written {
    if let Some(selector) = &own.selector {
        let number = (effect.target.strip_prefix(selector.as_str()))
            .ok_or_else(|| undescribed(format!("fault target `{}`", effect.target)))?;
        writeln!(text, "{} = {number}", key(selector))?;
    }
    settings(text, sizes, &own.sizes)?;
    match (&own.profile, &effect.profile) {
        (ProfileDescription::Step, Profile::Step) => {}
        (ProfileDescription::Exponential { speed }, Profile::Exponential { speed_per_s })
            if speed.admits(*speed_per_s) =>
        {
            let (name, unit) = (key(&speed.name), &speed.unit);
            writeln!(text, "{name} = {} # {unit}", toml_float(*speed_per_s))?;
        }
        (_, asked) => writeln!(text, "profile = {}", inline(entries(asked)))?,
    }
    Ok(())
}

/// Writes values in the order of their descriptions.
fn settings(text: &mut String, values: &Settings, fields: &[Field]) -> Written {
    for field in fields {
        let value = (values.get(&field.name))
            .ok_or_else(|| undescribed(format!("`{}` that fits the fault", field.name)))?;
        let (name, unit) = (key(&field.name), unit_of(field, None));
        writeln!(text, "{name} = {} # {unit}", toml_float(value))?;
    }
    Ok(())
}
