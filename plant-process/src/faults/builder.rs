//! Fault builder: converts a checked fault event into one that can act, outside the loop.
//!
//! Used at the start for a scenario's faults and by the service thread for live faults. Everything that a fault needs
//! is resolved, started and allocated here.

use hil_config::condition::Watch;
use hil_config::expression::Columns;
use hil_config::plan::{
    Condition, Definition, FaultAction, FaultEffect, FaultEvent, Move, Trigger,
};
use shared_types::describe::{
    ActsOn, FaultKindDescription, Invalid, Operation, PlantDescription, Settings,
};
use shared_types::record::FaultBegun;
use shared_types::side::Side;
use shared_types::table::Field;
use shared_types::time::Rate;

use super::arrivals::Arrivals;
use super::effect::{Action, Direction, Effect, Networks};
use super::kind::{AnySetup, FaultKindEntry};
use super::profile;

/// Builder of faults for one plant.
pub struct FaultBuilder {
    pub(super) parameters: Vec<Field>,
    pub(super) healthy: Vec<f64>,
    measured: Vec<Field>,
    reference: Vec<Field>,
    commands: Vec<Field>,
    inputs: Vec<Field>,
    /// Number of networks that carry frames of the link.
    networks: u8,
    kinds: Vec<FaultKindEntry>,
    pub(super) rate: Rate,
    pub(super) seed: u64,
    derived: Vec<(String, Definition)>,
}

/// Fault event that is ready to act.
pub struct ArmedFault {
    pub(super) event: FaultEvent,
    pub(super) effects: Vec<Effect>,
    pub(super) when: Option<Watch>,
    pub(super) until: Option<Watch>,
}

impl ArmedFault {
    /// Returns the event as requested.
    #[must_use]
    pub const fn event(&self) -> &FaultEvent {
        &self.event
    }
}

impl FaultBuilder {
    /// Creates a builder for a plant with these reference signals, healthy parameters and fault kinds.
    ///
    /// # Errors
    /// If a parameter of the plant has no value.
    pub fn new(
        plant: &PlantDescription,
        reference: &[Field],
        kinds: &[FaultKindEntry],
        parameters: &Settings,
        (rate, seed): (Rate, u64),
        derived: &[(String, Definition)],
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
            inputs: Vec::new(),
            networks: 1,
            kinds: kinds.to_vec(),
            rate,
            seed,
            derived: derived.to_vec(),
        })
    }

    /// Adds the inputs of the plant that the scenario drives.
    #[must_use]
    pub fn with_inputs(self, inputs: Vec<Field>) -> Self {
        Self { inputs, ..self }
    }

    /// Sets the number of networks that carry the frames of the link.
    #[must_use]
    pub fn with_networks(self, networks: u8) -> Self {
        Self { networks, ..self }
    }

    /// Returns the number of signals in a sample.
    pub(super) fn sample_width(&self) -> usize {
        self.measured.len() + self.reference.len()
    }

    /// Returns the number of the plant's commands.
    pub(super) fn commands(&self) -> usize {
        self.commands.len()
    }

    /// Returns the number of driven inputs of the plant.
    pub(super) fn inputs(&self) -> usize {
        self.inputs.len()
    }

    /// Builds the fault of an event; `columns` are the columns of a record, for conditions.
    ///
    /// # Errors
    /// If the event names something unknown, or its parameters are inconsistent.
    pub fn build(&self, event: FaultEvent, columns: &Columns) -> Result<ArmedFault, Invalid> {
        let watch = |condition: Option<&Condition>| {
            let watch =
                condition.map(|condition| Watch::new(condition, &self.derived, columns, self.rate));
            watch.transpose().map_err(|e| Invalid(e.to_string()))
        };
        let when = match &event.trigger {
            Trigger::Condition(condition) => Some(condition),
            _ => None,
        };
        Ok(ArmedFault {
            effects: self.effects(&event)?,
            when: watch(when)?,
            until: watch(event.end.condition.as_ref())?,
            event,
        })
    }

    /// Creates the effects of an event, which wait for its trigger.
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
        let result = match &effect.action {
            FaultAction::Move { moves, .. } => self.moves(moves)?,
            FaultAction::Kind { parameters, list } => {
                self.kind(&event.kind, &effect.target, parameters, list)?
            }
        };
        let course = profile::canonical(&effect.profile);
        let canonical = match result.canonical.as_str() {
            "" => course,
            action => format!("{action} {course}"),
        };
        let beginning = FaultBegun {
            id: event.id,
            effect: number,
            step: 0,
            kind: event.kind.clone(),
            target: effect.target.clone(),
            parameter: result.parameter,
            canonical,
            wall_only: result.wall_only,
        };
        Ok(Effect::new(
            beginning,
            result.unit,
            result.action,
            effect,
            &event.end,
        ))
    }

    fn moves(&self, moves: &[Move]) -> Result<BuiltAction, Invalid> {
        let targets = (moves.iter())
            .map(|one| Ok((self.parameter(&one.parameter)?, one.operation, one.by)))
            .collect::<Result<Vec<_>, Invalid>>()?;
        let first = targets.first().map(|(index, ..)| *index);
        let first = first.ok_or_else(|| Invalid("a fault that moves no parameter".into()))?;
        let names: Vec<&str> = moves.iter().map(|one| one.parameter.as_str()).collect();
        let canonical = moves.iter().map(|one| {
            let operation = match one.operation {
                Operation::Add => "add",
                Operation::Scale => "scale",
                Operation::Set => "set",
            };
            format!("{operation}={:016x}", one.by.to_bits())
        });
        Ok(BuiltAction {
            parameter: names.join(","),
            canonical: canonical.collect::<Vec<_>>().join(" "),
            unit: self.parameters[first].unit.clone(),
            action: Action::Move(targets),
            wall_only: false,
        })
    }

    fn parameter(&self, name: &str) -> Result<usize, Invalid> {
        (self.parameters.iter())
            .position(|field| field.faultable && field.name == name)
            .ok_or_else(|| Invalid(format!("`{name}` is not faultable")))
    }

    fn kind(
        &self,
        kind: &str,
        target: &str,
        parameters: &Settings,
        list: &[f64],
    ) -> Result<BuiltAction, Invalid> {
        let entry = (self.kinds.iter()).find(|entry| entry.description.kind == kind);
        let entry = entry.ok_or_else(|| Invalid(format!("there is no fault `{kind}`")))?;
        let place = self.place(entry.description.acts_on, target)?;
        let (place, unit) =
            place.ok_or_else(|| Invalid(format!("fault `{kind}` cannot act on `{target}`")))?;
        let fault = (entry.start)(&AnySetup {
            parameters,
            list,
            rate: self.rate,
            signals: match place {
                Place::Signal(Direction::Sample, _) => self.sample_width(),
                Place::Signal(Direction::Command, _) => self.commands(),
                Place::Signal(Direction::Input, _) => self.inputs(),
                _ => 0,
            },
            is_instrument: false,
        })?;
        let action = match place {
            Place::Parameter(index) => Action::Parameter(index, fault),
            Place::Signal(direction, index) => Action::Signal(direction, index, fault),
            Place::Link(direction, networks) => {
                Action::Link(direction, networks, fault, Box::new(Arrivals::new()))
            }
            Place::Answer => Action::Skip(fault, 0),
            Place::Side(side) => Action::Busy(side, fault, 0),
        };
        Ok(BuiltAction {
            parameter: target.strip_prefix("parameter.").unwrap_or(target).into(),
            canonical: canonical(&entry.description, parameters, list),
            unit,
            wall_only: matches!(action, Action::Busy(..)),
            action,
        })
    }

    /// Returns the place of a kind's target and the unit of its effect; `None` if there is no such target.
    fn place(&self, acts_on: ActsOn, target: &str) -> Result<Option<(Place, String)>, Invalid> {
        let steps = |place| Some((place, "steps".into()));
        let time = |side| Some((Place::Side(side), "ns".into()));
        let signal = |direction, fields: &[Field], before, name| {
            let index = fields.iter().position(|field| field.name == name)?;
            let unit = fields[index].unit.clone();
            Some((Place::Signal(direction, before + index), unit))
        };
        let (group, name) = target.split_once('.').unwrap_or((target, ""));
        Ok(match (acts_on, group) {
            (ActsOn::Signals | ActsOn::Numbers, "measured") => {
                signal(Direction::Sample, &self.measured, 0, name)
            }
            (ActsOn::Signals | ActsOn::Numbers, "reference") => {
                let before = self.measured.len();
                signal(Direction::Sample, &self.reference, before, name)
            }
            (ActsOn::Signals | ActsOn::Numbers, "command") => {
                signal(Direction::Command, &self.commands, 0, name)
            }
            (ActsOn::Signals | ActsOn::Numbers, "input") => {
                signal(Direction::Input, &self.inputs, 0, name)
            }
            (ActsOn::Numbers, "parameter") => {
                let index = self.parameter(name)?;
                Some((Place::Parameter(index), self.parameters[index].unit.clone()))
            }
            (ActsOn::Links, "link") => match Networks::split(name, self.networks) {
                ("sample", networks) => steps(Place::Link(Direction::Sample, networks)),
                ("command", networks) => steps(Place::Link(Direction::Command, networks)),
                _ => None,
            },
            (ActsOn::Controller, "controller") if name.is_empty() => steps(Place::Answer),
            (ActsOn::Sides, "controller") if name.is_empty() => time(Side::Controller),
            (ActsOn::Sides, "plant") if name.is_empty() => time(Side::Plant),
            _ => None,
        })
    }
}

/// Place at which an effect of a kind acts.
enum Place {
    /// A parameter.
    Parameter(usize),
    /// A signal.
    Signal(Direction, usize),
    /// The link.
    Link(Direction, Networks),
    /// Step at which the controller's answer takes effect.
    Answer,
    /// Computing time of a side.
    Side(Side),
}

/// Action with its description.
struct BuiltAction {
    action: Action,
    parameter: String,
    canonical: String,
    unit: String,
    wall_only: bool,
}

/// Formats the settings that determine an effect in canonical form with exact bits: the parameters in the order of the
/// kind's table, then the list.
fn canonical(kind: &FaultKindDescription, parameters: &Settings, list: &[f64]) -> String {
    let value_of = |field: &Field| Some((field.name.clone(), parameters.get(&field.name)?));
    let mut parts: Vec<String> = (kind.parameters.iter().filter_map(value_of))
        .map(|(name, value)| format!("{name}={:016x}", value.to_bits()))
        .collect();
    if !list.is_empty() {
        let bits = list.iter().map(|value| format!("{:016x}", value.to_bits()));
        parts.push(format!("list={}", bits.collect::<Vec<_>>().join(",")));
    }
    parts.join(" ")
}
