//! The workshop: turns a checked fault event into one that can act, away from the loop.
//!
//! Used at the start for a scenario's faults and by the service thread for live ones. Everything
//! that a fault needs is found, started and allocated here.

use hil_config::condition::Watch;
use hil_config::expression::Columns;
use hil_config::plan::{Condition, FaultAction, FaultEffect, FaultEvent, Move, Trigger};
use shared_types::describe::{ActsOn, Invalid, PlantDescription, Settings};
use shared_types::record::FaultTaken;
use shared_types::table::Field;
use shared_types::time::Rate;

use super::arrivals::Arrivals;
use super::effect::{Action, Direction, Effect, Side};
use super::kind::{AnySetup, FaultKindEntry};
use super::profile;

/// What faults are made of.
pub struct FaultWorkshop {
    pub(super) parameters: Vec<Field>,
    pub(super) healthy: Vec<f64>,
    measured: Vec<Field>,
    reference: Vec<Field>,
    commands: Vec<Field>,
    kinds: Vec<FaultKindEntry>,
    pub(super) rate: Rate,
    pub(super) seed: u64,
    derived: Vec<(String, String)>,
}

/// A fault event that is ready to act.
pub struct Prepared {
    pub(super) event: FaultEvent,
    pub(super) effects: Vec<Effect>,
    pub(super) when: Option<Watch>,
    pub(super) until: Option<Watch>,
}

impl Prepared {
    /// The event as it was asked for.
    #[must_use]
    pub const fn event(&self) -> &FaultEvent {
        &self.event
    }
}

impl FaultWorkshop {
    /// A workshop for a plant with these reference signals, healthy parameters and kinds of faults.
    ///
    /// # Errors
    /// If a parameter of the plant has no value.
    pub fn new(
        plant: &PlantDescription,
        reference: &[Field],
        kinds: &[FaultKindEntry],
        parameters: &Settings,
        (rate, seed): (Rate, u64),
        derived: &[(String, String)],
    ) -> Result<Self, Invalid> {
        let healthy = (plant.parameters.iter())
            .map(|field| {
                let value = parameters.get(&field.name);
                value.ok_or_else(|| Invalid(format!("parameter `{}` is missing", field.name)))
            })
            .collect::<Result<_, _>>()?;
        Ok(Self {
            parameters: plant.parameters.clone(),
            healthy,
            measured: plant.measured.clone(),
            reference: reference.to_vec(),
            commands: plant.commands.clone(),
            kinds: kinds.to_vec(),
            rate,
            seed,
            derived: derived.to_vec(),
        })
    }

    /// Signals of a sample.
    pub(super) fn sample_width(&self) -> usize {
        self.measured.len() + self.reference.len()
    }

    /// The plant's commands.
    pub(super) fn commands(&self) -> usize {
        self.commands.len()
    }

    /// Prepares an event; `columns` are those of a record, which conditions need.
    ///
    /// # Errors
    /// If it names something that there is not, or its parameters do not go together.
    pub fn prepare(&self, event: FaultEvent, columns: &Columns) -> Result<Prepared, Invalid> {
        let watch = |condition: Option<&Condition>| {
            let watch = condition.map(|condition| Watch::new(condition, &self.derived, columns));
            watch.transpose().map_err(|e| Invalid(e.to_string()))
        };
        let when = match &event.trigger {
            Trigger::Condition(condition) => Some(condition),
            _ => None,
        };
        Ok(Prepared {
            effects: self.effects(&event)?,
            when: watch(when)?,
            until: watch(event.end.condition.as_ref())?,
            event,
        })
    }

    /// The effects of an event, which wait for it to take hold.
    pub(super) fn effects(&self, event: &FaultEvent) -> Result<Vec<Effect>, Invalid> {
        (0..)
            .zip(&event.effects)
            .map(|(number, effect)| self.effect(event, number, effect))
            .collect()
    }

    fn effect(
        &self,
        event: &FaultEvent,
        number: u32,
        effect: &FaultEffect,
    ) -> Result<Effect, Invalid> {
        let made = match &effect.action {
            FaultAction::Move { moves, .. } => self.moves(moves)?,
            FaultAction::Kind { parameters, list } => {
                self.kind(&event.kind, &effect.target, parameters, list)?
            }
        };
        let course = profile::canonical(&effect.profile);
        let canonical = match made.canonical.as_str() {
            "" => course,
            action => format!("{action} {course}"),
        };
        let taken = FaultTaken {
            id: event.id,
            effect: number,
            step: 0,
            kind: event.kind.clone(),
            target: effect.target.clone(),
            parameter: made.parameter,
            canonical,
            wall_only: made.wall_only,
        };
        Ok(Effect::new(
            taken,
            made.unit,
            made.action,
            effect,
            &event.end,
        ))
    }

    fn moves(&self, moves: &[Move]) -> Result<Made, Invalid> {
        let mut found = Vec::new();
        let mut canonical = Vec::new();
        for given in moves {
            found.push((self.parameter(&given.parameter)?, given.operation, given.by));
            let operation = serde_json::to_value(given.operation).unwrap_or_default();
            let operation = operation.as_str().unwrap_or_default();
            canonical.push(format!("{operation}={:016x}", given.by.to_bits()));
        }
        let names: Vec<&str> = moves.iter().map(|given| given.parameter.as_str()).collect();
        let first = found.first().map(|(index, ..)| *index);
        let first = first.ok_or_else(|| Invalid("a fault that moves no parameter".into()))?;
        Ok(Made {
            parameter: names.join(","),
            canonical: canonical.join(" "),
            unit: self.parameters[first].unit.clone(),
            action: Action::Move(found),
            wall_only: false,
        })
    }

    fn parameter(&self, name: &str) -> Result<usize, Invalid> {
        (self.parameters.iter())
            .position(|field| field.faultable && field.name == name)
            .ok_or_else(|| Invalid(format!("`{name}` is not open to faults")))
    }

    fn kind(
        &self,
        kind: &str,
        target: &str,
        parameters: &Settings,
        list: &[f64],
    ) -> Result<Made, Invalid> {
        let entry = (self.kinds.iter()).find(|entry| entry.description.kind == kind);
        let entry = entry.ok_or_else(|| Invalid(format!("there is no fault `{kind}`")))?;
        let fault = (entry.start)(&AnySetup {
            parameters,
            list,
            rate: self.rate,
        })?;
        let description = &entry.description;
        let acts_on = description.acts_on;
        let place = |fields: &[Field], name: &str| {
            let found = fields.iter().position(|field| field.name == name);
            found.map(|index| (index, fields[index].unit.clone()))
        };
        let wrong = || Invalid(format!("fault `{kind}` cannot act on `{target}`"));
        let signals = matches!(acts_on, ActsOn::Signals | ActsOn::Numbers);
        let links = acts_on == ActsOn::Links;
        let link = |direction, fault| Action::Link(direction, fault, Box::new(Arrivals::new()));
        let (action, unit) = match target.split_once('.') {
            Some(("measured", name)) if signals => {
                let (index, unit) = place(&self.measured, name).ok_or_else(wrong)?;
                (Action::Signal(Direction::Sample, index, fault), unit)
            }
            Some(("reference", name)) if signals => {
                let (index, unit) = place(&self.reference, name).ok_or_else(wrong)?;
                let index = self.measured.len() + index;
                (Action::Signal(Direction::Sample, index, fault), unit)
            }
            Some(("command", name)) if signals => {
                let (index, unit) = place(&self.commands, name).ok_or_else(wrong)?;
                (Action::Signal(Direction::Command, index, fault), unit)
            }
            Some(("parameter", name)) if acts_on == ActsOn::Numbers => {
                let index = self.parameter(name)?;
                let unit = self.parameters[index].unit.clone();
                (Action::Parameter(index, fault), unit)
            }
            Some(("link", "sample")) if links => (link(Direction::Sample, fault), "steps".into()),
            Some(("link", "command")) if links => (link(Direction::Command, fault), "steps".into()),
            None if target == "controller" && acts_on == ActsOn::Controller => {
                (Action::Skip(fault, 0), "steps".into())
            }
            None if target == "controller" && acts_on == ActsOn::Sides => {
                (Action::Busy(Side::Controller, fault, 0), "ns".into())
            }
            None if target == "plant" && acts_on == ActsOn::Sides => {
                (Action::Busy(Side::Plant, fault, 0), "ns".into())
            }
            _ => return Err(wrong()),
        };
        let mut canonical: Vec<String> = (description.parameters.iter())
            .filter_map(|field| Some((field, parameters.get(&field.name)?)))
            .map(|(field, value)| format!("{}={:016x}", field.name, value.to_bits()))
            .collect();
        if !list.is_empty() {
            let bits = list.iter().map(|value| format!("{:016x}", value.to_bits()));
            canonical.push(format!("list={}", bits.collect::<Vec<_>>().join(",")));
        }
        let parameter = target.strip_prefix("parameter.").unwrap_or(target);
        Ok(Made {
            wall_only: matches!(action, Action::Busy(..)),
            parameter: parameter.into(),
            canonical: canonical.join(" "),
            unit,
            action,
        })
    }
}

/// An action and what is told of it.
struct Made {
    action: Action,
    parameter: String,
    canonical: String,
    unit: String,
    wall_only: bool,
}
