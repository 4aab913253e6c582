//! Taps: inputs of instruments and of their stages that a run records, in the groups `sensor` and `actuator`.
//!
//! The input of a chain has the name of its signal, `sensor.angle_rad`; that of a later stage has the stage's key before
//! it, `sensor.lag_hz.angle_rad`. Only the inputs that `--record` or the scenario names are recorded; without such
//! names a run has neither their columns nor their work.

use std::collections::{HashMap, HashSet};

use shared_types::describe::PlantDescription;
use shared_types::layout::schema_name;
use shared_types::table::Field;
use shared_types::time::Rate;

use super::{AnalysisKind, DerivedSource, Instrument, Plan, Plot, Stage, Trigger};
use crate::expression::{Columns, Expression, Group};

/// Groups of the taps of sensors and of actuators.
const GROUPS: [Group; 2] = [Group::Sensor, Group::Actuator];

/// Lists the taps of a chain: the name of each, and the index of the stage whose input it is.
#[must_use]
pub fn taps_of(signal: &str, stages: &[Stage]) -> Vec<(String, usize)> {
    let mut keys = HashSet::new();
    let of_stage = |(index, stage): (usize, &Stage)| {
        keys.insert(stage.key).then(|| match index {
            0 => (signal.to_owned(), 0),
            index => (format!("{}.{signal}", stage.key), index),
        })
    };
    stages.iter().enumerate().filter_map(of_stage).collect()
}

/// Returns the columns of the recorded taps of sensors and of actuators, in order.
#[must_use]
pub fn tap_fields(
    plant: &PlantDescription,
    instruments: [&[Instrument]; 2],
    rate: Rate,
) -> [Vec<Field>; 2] {
    let [sensors, actuators] = possible(plant, instruments, rate);
    let recorded = |all: Vec<(usize, Field)>, instruments: &[Instrument]| {
        let all = all.into_iter();
        let is_recorded =
            |(index, field): &(usize, Field)| instruments[*index].taps.contains(&field.name);
        all.filter(is_recorded).map(|(_, field)| field).collect()
    };
    [
        recorded(sensors, instruments[0]),
        recorded(actuators, instruments[1]),
    ]
}

/// Lists the columns of all possible taps of sensors and of actuators, each with the index of its instrument.
fn possible(
    plant: &PlantDescription,
    [sensors, actuators]: [&[Instrument]; 2],
    rate: Rate,
) -> [Vec<(usize, Field)>; 2] {
    let of = |index: usize, signal: &str, fields: &[Field], stages: &[Stage]| {
        let own = fields.iter().find(|field| field.name == signal);
        let column = |(name, place): (String, usize)| {
            let own = own?;
            let (at, prefix) = match stages[place].key {
                _ if place == 0 => (String::new(), String::new()),
                key => (format!(" at its stage `{key}`"), format!("{key}.")),
            };
            let aliases = own.aliases.iter();
            let field = Field {
                name,
                description: format!("Input of the instrument of {signal}{at}."),
                aliases: aliases.map(|alias| format!("{prefix}{alias}")).collect(),
                ..own.clone()
            };
            Some((index, field))
        };
        let taps = taps_of(signal, stages).into_iter();
        taps.filter_map(column).collect::<Vec<_>>()
    };
    let (measured, commands) = (&plant.measured, &plant.commands);
    let sensors = (sensors.iter().enumerate()).flat_map(|(index, one)| {
        of(
            index,
            &one.signal,
            measured,
            &one.sensor_stages(rate, measured),
        )
    });
    let actuators = (actuators.iter().enumerate())
        .flat_map(|(index, one)| of(index, &one.signal, commands, &one.actuator_stages(rate)));
    [sensors.collect(), actuators.collect()]
}

/// Returns two taps that a recording could not distinguish, by their full names, and the index of the instrument of
/// the second in the table that is named first.
pub(crate) fn indistinguishable(
    plant: &PlantDescription,
    instruments: [&[Instrument]; 2],
    rate: Rate,
) -> Option<(&'static str, usize, [String; 2])> {
    let all = possible(plant, instruments, rate);
    let tables = ["sensors", "actuators"];
    let sides = tables.into_iter().zip(GROUPS).zip(instruments);
    for (((table, group), instruments), taps) in sides.zip(all) {
        let mut names: HashMap<String, (usize, String)> = HashMap::new();
        for (index, Field { name, .. }) in taps {
            let full = format!("{}.{name}", group.prefix());
            let other = names.insert(schema_name(&name), (index, full.clone()));
            // Two entries of one signal are another fault.
            let is_other = |at: usize| instruments[at].signal != instruments[index].signal;
            if let Some((_, other)) = other.filter(|(at, _)| is_other(*at)) {
                return Some((table, index, [other, full]));
            }
        }
    }
    None
}

impl Columns {
    /// Adds the columns of taps of sensors and of actuators.
    pub(crate) fn push_taps<'a>(&mut self, taps: [impl IntoIterator<Item = &'a Field>; 2]) {
        for (group, fields) in GROUPS.into_iter().zip(taps) {
            for field in fields {
                self.push_field(group, field);
            }
        }
    }

    /// Adds the columns of all taps that these instruments can have.
    pub(crate) fn push_possible_taps(
        &mut self,
        plant: &PlantDescription,
        instruments: [&[Instrument]; 2],
        rate: Rate,
    ) {
        let all = possible(plant, instruments, rate);
        self.push_taps(
            all.each_ref()
                .map(|taps| taps.iter().map(|(_, field)| field)),
        );
    }
}

impl Plan {
    /// Returns the columns of the recorded taps of sensors and of actuators, in order.
    #[must_use]
    pub fn tap_fields(&self, plant: &PlantDescription) -> [Vec<Field>; 2] {
        tap_fields(plant, [&self.sensors, &self.actuators], self.run.rate)
    }

    /// Also records the taps whose full names, such as `sensor.angle_rad`, satisfy `is_recorded`.
    pub fn tap(&mut self, plant: &PlantDescription, is_recorded: impl Fn(&str) -> bool) {
        self.tap_fields_of(plant, |group, field| {
            is_recorded(&format!("{}.{}", group.prefix(), field.name))
        });
    }

    fn tap_fields_of(
        &mut self,
        plant: &PlantDescription,
        is_recorded: impl Fn(Group, &Field) -> bool,
    ) {
        let all = possible(plant, [&self.sensors, &self.actuators], self.run.rate);
        let sides = [&mut self.sensors, &mut self.actuators];
        for ((group, taps), instruments) in GROUPS.into_iter().zip(all).zip(sides) {
            for (index, field) in taps {
                let recorded = &mut instruments[index].taps;
                if is_recorded(group, &field) && !recorded.contains(&field.name) {
                    recorded.push(field.name);
                }
            }
        }
    }

    /// Records the taps that the scenario's expressions, plots and panel name, also by an alias.
    pub(crate) fn tap_named(&mut self, plant: &PlantDescription) {
        if self.sensors.is_empty() && self.actuators.is_empty() {
            return;
        }
        let names = self.named_signals();
        self.tap_fields_of(plant, |group, field| {
            (field.names()).any(|name| names.contains(&format!("{}.{name}", group.prefix())))
        });
    }

    /// Lists all signals that its expressions, plots and panel name.
    fn named_signals(&self) -> HashSet<String> {
        let derived = self.derived.iter().filter_map(|one| match &one.source {
            DerivedSource::Expression(expression) => Some(expression),
            DerivedSource::Table(_) => None,
        });
        let metrics = self.metrics.iter().map(|one| &one.expression);
        let requirements = (self.requirements.iter()).flat_map(|one| one.formula.expressions());
        let analyses = self.analyses.iter().flat_map(|one| match &one.kind {
            AnalysisKind::StepResponse(plan) => vec![&plan.signal],
            AnalysisKind::FrequencyResponse(plan) => vec![&plan.input, &plan.output],
            AnalysisKind::Detection(plan) => {
                let effect = plan.effect.as_ref().map(|(effect, _)| effect);
                let others = plan.recovered.iter().chain(effect);
                [&plan.alarm].into_iter().chain(others).collect()
            }
        });
        let conditions = self.faults.iter().flat_map(|event| {
            let begin = match &event.trigger {
                Trigger::Condition(condition) => Some(condition),
                _ => None,
            };
            begin.into_iter().chain(&event.end.condition)
        });
        let mut names = HashSet::new();
        for expression in derived.chain(metrics).chain(requirements).chain(analyses) {
            names.extend(expression.signals().map(Into::into));
        }
        for expression in conditions.filter_map(|one| Expression::parse(&one.expression).ok()) {
            names.extend(expression.signals().map(Into::into));
        }
        let plotted = self.plots.iter().flat_map(Plot::read_signals);
        names.extend(plotted.chain(&self.panel.readings).cloned());
        names
    }
}
