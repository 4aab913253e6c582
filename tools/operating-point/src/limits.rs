//! Numbers of an equilibrium beyond a limit: those at which a run ends, and the ranges of sensors and actuators. Judges
//! no equilibrium.

use hil_config::plan::{Instrument, Plan};
use serde::Serialize;
use shared_types::describe::PlantDescription;
use shared_types::local_map::{LocalMap, Variable};
use shared_types::number::{exact, exact_in};

/// Limit that a number exceeds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Limit {
    /// Validity of the plant, by itself or by `[plant.limits]`.
    Plant,
    /// Range of a sensor.
    Sensor,
    /// Range of an actuator.
    Actuator,
}

/// Number beyond a limit.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Exceeded {
    #[serde(flatten)]
    variable: Variable,
    min: f64,
    max: f64,
    of: Limit,
}

impl Exceeded {
    /// Describes the number and the consequence.
    pub(crate) fn described(&self) -> String {
        let Variable { name, unit, value } = &self.variable;
        let consequence = match self.of {
            Limit::Plant => "a run ends there",
            Limit::Sensor => "its sensor saturates there",
            Limit::Actuator => "its actuator does not reach it",
        };
        let (value, min, max) = (
            exact_in(*value, unit),
            exact(self.min),
            exact_in(self.max, unit),
        );
        format!("`{name}` = {value} is outside {min} to {max}: {consequence}")
    }
}

/// Lists the numbers of a map beyond the limits of its plant and the ranges of the scenario's instruments.
pub(crate) fn exceeded(plan: &Plan, plant: &PlantDescription, map: &LocalMap) -> Vec<Exceeded> {
    let find = |all: &[Variable], name: &str| all.iter().find(|one| one.name == name).cloned();
    let mut all: Vec<Exceeded> = Vec::new();
    let mut judge = |variable: Option<Variable>, (min, max): (f64, f64), of: Limit| {
        let beyond = variable.filter(|one| !(min..=max).contains(&one.value));
        all.extend(beyond.map(|variable| Exceeded {
            variable,
            min,
            max,
            of,
        }));
    };
    for field in &plant.truth {
        // A program of an older version does not tell the truth of a point.
        let known = find(&map.truth, &field.name).or_else(|| find(&map.states, &field.name));
        let limit = { plan.plant.limits.iter() }.find(|limit| limit.signal == field.name);
        let range = limit.map_or((field.min, field.max), |limit| (limit.min, limit.max));
        judge(known, range, Limit::Plant);
    }
    for field in &plant.measured {
        if !plant.truth.iter().any(|truth| truth.name == field.name) {
            let known = find(&map.outputs, &field.name);
            judge(known, (field.min, field.max), Limit::Plant);
        }
    }
    let instruments = [
        (&plan.sensors, &map.outputs, Limit::Sensor),
        (&plan.actuators, &map.inputs, Limit::Actuator),
    ];
    for (instruments, signals, of) in instruments {
        for (name, range) in instruments.iter().filter_map(named_range) {
            judge(find(signals, name), range, of);
        }
    }
    all
}

fn named_range(instrument: &Instrument) -> Option<(&str, (f64, f64))> {
    Some((&instrument.signal, instrument.range()?))
}
