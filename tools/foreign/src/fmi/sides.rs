//! An FMU as a plant or as a law.
//!
//! For a plant, inputs are the commands, outputs are measured and truth signals, and requested local signals are
//! truth. For a law, inputs are measured and reference signals, and outputs are the commands.

use std::sync::Arc;

use controller_process::controller::{Law, LawKind, Row, SetupRows, Transition, TunedRows};
use plant_process::plant::{Model as PlantModel, PlantKind};
use serde::{Deserialize, Serialize};
use shared_types::describe::{Invalid, LawDescription, PlantDescription};
use shared_types::failure::Failure;
use shared_types::local_map::{LocalMap, Variable};
use shared_types::state::State;
use shared_types::table::Field;
use shared_types::time::Interval;

use super::instance::{Instance, check_period};
use super::linear;
use super::tables::{Column, reference_name};
use super::{Fmu, FmuError, Model};

/// Creates the plant of an FMU.
///
/// # Errors
/// If its variables do not form valid tables.
pub fn plant(fmu: &Arc<Fmu>) -> Result<PlantKind, FmuError> {
    let described = plant_description(fmu.model());
    let fmu = Arc::clone(fmu);
    let kind = PlantKind::from_tables(described, move |parameters| {
        Ok(Box::new(FmuPlant(start(&fmu, parameters)?)))
    });
    Ok(kind?)
}

/// Builds the tables of a model as a plant.
#[must_use]
pub fn plant_description(model: &Model) -> PlantDescription {
    let Model {
        description,
        tables,
        ..
    } = model;
    let outputs = fields(&tables.outputs);
    PlantDescription {
        name: description.identifier.clone(),
        summary: summary(model),
        parameters: fields(&tables.parameters),
        truth: [&outputs[..], &fields(&tables.locals)].concat(),
        measured: outputs.iter().map(free).collect(),
        commands: fields(&tables.inputs),
        faults: Vec::new(),
        saves: description.saves,
        port: None,
        state: None,
    }
}

/// Creates the law of an FMU.
///
/// # Errors
/// If its variables do not form valid tables.
pub fn law(fmu: &Arc<Fmu>) -> Result<LawKind, FmuError> {
    let described = law_description(fmu.model());
    let fmu = Arc::clone(fmu);
    let kind = LawKind::from_tables(described, move |setup: &SetupRows<'_>| {
        check_period(fmu.model(), setup.period_s, "controller.rate_hz")?;
        Ok(Box::new(FmuLaw {
            is_reference: (fmu.model().tables.inputs.iter())
                .map(|column| reference_name(&column.field.name).is_some())
                .collect(),
            inputs: vec![0.0; fmu.model().tables.inputs.len()],
            commands: fmu.model().tables.outputs.len(),
            instance: start(&fmu, setup.parameters)?,
            period_s: setup.period_s,
            clock: Clock::default(),
        }))
    });
    Ok(kind?)
}

/// Builds the tables of a model as a law.
#[must_use]
pub fn law_description(model: &Model) -> LawDescription {
    let Model {
        description,
        tables,
        ..
    } = model;
    let (measured, reference) = tables.split_inputs();
    let mut parameters = tables.parameters.iter();
    let is_tunable = parameters.any(|column| column.field.faultable);
    LawDescription {
        name: description.identifier.clone(),
        summary: summary(model),
        plants: Vec::new(),
        parameters: fields(&tables.parameters).iter().map(of_law).collect(),
        model: Vec::new(),
        measured: measured.iter().map(free).collect(),
        reference: reference.iter().map(free).collect(),
        commands: Some(fields(&tables.outputs).iter().map(free).collect()),
        internals: fields(&tables.locals).iter().map(free).collect(),
        saves: description.saves,
        state: None,
        tuning: match is_tunable {
            true => "The FMU applies the values before its next step; its own equations determine the command.".into(),
            false => String::new(),
        },
    }
}

fn start(fmu: &Fmu, parameters: &[f64]) -> Result<Instance, Invalid> {
    let loaded = fmu.loaded().map_err(|error| Invalid(error.to_string()))?;
    Instance::start(
        fmu.model(),
        &loaded.functions,
        &loaded.resources,
        parameters,
    )
}

fn summary(model: &Model) -> String {
    let Model {
        description,
        tables,
        ..
    } = model;
    let format = &tables.imported.format;
    let text = match description.description.as_str() {
        "" => &description.name,
        text => text,
    };
    format!("{} (FMU of {format})", shared_types::text::line(text))
}

fn fields(columns: &[Column]) -> Vec<Field> {
    columns.iter().map(|column| column.field.clone()).collect()
}

/// Returns a signal without range limits and start value.
fn free(field: &Field) -> Field {
    Field {
        min: f64::NEG_INFINITY,
        max: f64::INFINITY,
        default: None,
        ..field.clone()
    }
}

/// Returns a parameter of a law, which faults cannot change.
fn of_law(field: &Field) -> Field {
    Field {
        faultable: false,
        tunable: field.faultable,
        ..field.clone()
    }
}

/// FMU as a plant.
struct FmuPlant(Instance);

impl PlantModel for FmuPlant {
    fn retune(&mut self, parameters: &[f64]) -> Result<(), Failure> {
        self.0.retune(parameters);
        Ok(())
    }

    fn measure(&mut self, measured: &mut [f64]) -> Result<(), Failure> {
        measured.copy_from_slice(&self.0.signals()[..measured.len()]);
        Ok(())
    }

    fn truth(&mut self, _: f64, _: &[f64], truth: &mut [f64]) -> Result<(), Failure> {
        truth.copy_from_slice(self.0.signals());
        Ok(())
    }

    fn advance(&mut self, interval: &Interval, command: &[f64]) -> Result<(), Failure> {
        self.0.step(interval, command)
    }

    fn check_period(&self, period_s: f64) -> Result<(), Invalid> {
        check_period(self.0.model(), period_s, "run.rate_hz")
    }

    fn check_start(&self) -> Result<(), Invalid> {
        self.0.check_start()
    }

    fn unreadable(&self) -> Vec<String> {
        self.0.unreadable()
    }

    fn save(&self) -> Result<State, Invalid> {
        self.0.save()
    }

    fn restore(&mut self, state: &State) -> Result<(), Invalid> {
        self.0.restore(state)
    }

    fn differentiated(&mut self, inputs: &[f64], length_s: f64) -> Result<LocalMap, Invalid> {
        linear::map(&mut self.0, inputs, length_s)
    }
}

/// FMU as a law. The sample of a step is set, one period is executed, and the command is read.
struct FmuLaw {
    instance: Instance,
    /// For each input, `true` if it is a reference signal.
    is_reference: Vec<bool>,
    inputs: Vec<f64>,
    commands: usize,
    period_s: f64,
    clock: Clock,
}

/// Clock of the FMU in a law: it starts at 0 with the first sample, which comes later for a controller that takes
/// over.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct Clock {
    /// Simulated time of the first sample, in s.
    first_s: Option<f64>,
    /// Time that the FMU has reached, in s of its own clock.
    reached_s: f64,
}

impl Law for FmuLaw {
    fn step(
        &mut self,
        sample: &Row<'_>,
        command: &mut [f64],
        internals: &mut [f64],
    ) -> Result<(), Failure> {
        self.take(sample.measured, sample.reference);
        let at_s = sample.time_s - *self.clock.first_s.get_or_insert(sample.time_s);
        // In real time samples may be skipped; the FMU has a fixed step and catches up.
        while at_s - self.clock.reached_s > 0.5 * self.period_s {
            self.advance(self.clock.reached_s)?;
        }
        self.advance(at_s)?;
        let (commands, inner) = self.instance.signals().split_at(self.commands);
        command.copy_from_slice(commands);
        internals.copy_from_slice(inner);
        Ok(())
    }

    fn retune(&mut self, setup: &TunedRows<'_>, _: Transition) {
        self.instance.retune(setup.parameters);
    }

    fn check_start(&self) -> Result<(), Invalid> {
        self.instance.check_start()
    }

    fn unreadable(&self) -> Vec<String> {
        self.instance.unreadable()
    }

    fn save(&self) -> Result<State, Invalid> {
        State::of(&(self.instance.save()?, self.clock))
    }

    fn restore(&mut self, state: &State) -> Result<(), Invalid> {
        let (instance, clock): (State, Clock) = state.read()?;
        self.instance.restore(&instance)?;
        self.clock = clock;
        Ok(())
    }

    fn differentiated(&mut self, sample: &[f64], length_s: f64) -> Result<LocalMap, Invalid> {
        let (_, reference) = self.instance.model().tables.split_inputs();
        let (measured, reference) = sample.split_at(sample.len() - reference.len());
        self.take(measured, reference);
        let map = linear::map(&mut self.instance, &self.inputs, length_s)?;
        Ok(grouped(map))
    }
}

/// Orders the inputs of a law's map as in a sample: the measured signals, then the reference signals, each named with
/// its group.
fn grouped(mut map: LocalMap) -> LocalMap {
    let states = map.states.len();
    let columns = map.columns.split_off(states).into_iter();
    let both = std::mem::take(&mut map.inputs).into_iter().zip(columns);
    let of_group = |(mut input, column): (Variable, Vec<f64>)| {
        let reference = reference_name(&input.name).map(ToOwned::to_owned);
        let is_reference = reference.is_some();
        input.name = match reference {
            Some(name) => format!("reference.{name}"),
            None => format!("measured.{}", input.name),
        };
        (is_reference, input, column)
    };
    let mut inputs: Vec<(bool, Variable, Vec<f64>)> = both.map(of_group).collect();
    inputs.sort_by_key(|(is_reference, ..)| *is_reference);
    for (_, input, column) in inputs {
        map.inputs.push(input);
        map.columns.push(column);
    }
    map
}

impl FmuLaw {
    /// Sets the inputs to a sample.
    fn take(&mut self, measured: &[f64], reference: &[f64]) {
        let (mut measured, mut reference) = (measured.iter(), reference.iter());
        for (input, is_reference) in self.inputs.iter_mut().zip(&self.is_reference) {
            let next = if *is_reference {
                reference.next()
            } else {
                measured.next()
            };
            *input = next.copied().unwrap_or_default();
        }
    }

    fn advance(&mut self, at_s: f64) -> Result<(), Failure> {
        let interval = Interval {
            start_s: at_s,
            length_s: self.period_s,
            substeps: 1,
        };
        self.clock.reached_s = at_s + self.period_s;
        self.instance.step(&interval, &self.inputs)
    }
}
