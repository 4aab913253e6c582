//! A class as a [`PlantKind`].

use std::sync::Arc;

use plant_process::plant::{Model, PlantKind};
use pyo3::prelude::*;
use pyo3::{Py, intern};
use shared_types::describe::{FaultDescription, Invalid, PlantDescription};
use shared_types::failure::Failure;
use shared_types::quality::SignalSet;
use shared_types::side::Side;
use shared_types::state::State;
use shared_types::time;

use super::arguments::Interval;
use super::failure::{between_steps, declaration, during_run};
use super::saving::Saving;
use super::tables::Rows;

/// Side of the classes here.
const SIDE: Side = Side::Plant;

/// Class of a plant.
struct Shape {
    class: Py<PyAny>,
    parameters: Rows,
    truth: Rows,
    measured: Rows,
    command: Rows,
    saving: Saving,
    retunes: bool,
    marks_invalid: bool,
}

/// Instance of the class.
struct InPython {
    shape: Arc<Shape>,
    instance: Py<PyAny>,
}

/// Returns the plant of a class that is marked with `@hil.plant`.
///
/// # Errors
/// If the class is not marked, or a table breaks a rule; the exception names the row.
pub(crate) fn plant_kind(class: &Bound<'_, PyAny>) -> PyResult<PlantKind> {
    let side = super::declaration(class, "plant")?;
    let methods: Vec<String> = side.getattr("methods")?.extract()?;
    let has = |name: &str| methods.iter().any(|method| method == name);
    let table = |role| Rows::of_role(&side, role);
    let shape = Shape {
        class: class.clone().unbind(),
        parameters: table("parameters")?,
        truth: table("truth")?,
        measured: table("measured")?,
        command: table("command")?,
        saving: Saving::of(&side, has("save"))?,
        retunes: has("retune"),
        marks_invalid: has("invalid"),
    };
    let description = PlantDescription {
        name: side.getattr("name")?.extract()?,
        summary: side.getattr("summary")?.extract()?,
        parameters: shape.parameters.fields.clone(),
        truth: shape.truth.fields.clone(),
        measured: shape.measured.fields.clone(),
        commands: shape.command.fields.clone(),
        faults: faults(&side)?,
        saves: shape.saving.saves(),
        port: None,
        state: shape.saving.fields(),
    };
    let shape = Arc::new(shape);
    let kind = PlantKind::from_tables(description, move |row| {
        let instance = between_steps("__init__", |py| {
            let parameters = shape.parameters.instance(py, row)?;
            Ok(shape.class.bind(py).call1((parameters,))?.unbind())
        })?;
        let shape = Arc::clone(&shape);
        Ok(Box::new(InPython { shape, instance }))
    });
    kind.map_err(|invalid| declaration(class.py(), invalid.to_string()))
}

/// Reads the faults of a declaration.
fn faults(side: &Bound<'_, PyAny>) -> PyResult<Vec<FaultDescription>> {
    let json: String = side.getattr("faults")?.extract()?;
    serde_json::from_str(&json).map_err(|error| declaration(side.py(), error.to_string()))
}

impl InPython {
    /// Writes the readings.
    fn readings(&self, py: Python<'_>, measured: &mut [f64]) -> PyResult<()> {
        let readings = self
            .instance
            .bind(py)
            .call_method0(intern!(py, "measure"))?;
        self.shape.measured.read(&readings, measured, "measure")
    }
}

impl Model for InPython {
    fn retune(&mut self, parameters: &[f64]) -> Result<(), Failure> {
        if !self.shape.retunes {
            return Ok(());
        }
        during_run(SIDE, "retune", |py| {
            let parameters = self.shape.parameters.instance(py, parameters)?;
            let instance = self.instance.bind(py);
            super::tables::nothing(
                &instance.call_method1(intern!(py, "retune"), (parameters,))?,
                "retune",
            )
        })
    }

    fn measure(&mut self, measured: &mut [f64]) -> Result<(), Failure> {
        during_run(SIDE, "measure", |py| self.readings(py, measured))
    }

    fn read(&mut self, measured: &mut [f64], invalid: &mut SignalSet) -> Result<(), Failure> {
        during_run(SIDE, "measure", |py| {
            self.readings(py, measured)?;
            if self.shape.marks_invalid {
                let names = self
                    .instance
                    .bind(py)
                    .call_method0(intern!(py, "invalid"))?;
                self.shape.measured.mark(&names, invalid, "invalid")?;
            }
            Ok(())
        })
    }

    fn truth(&mut self, time_s: f64, command: &[f64], truth: &mut [f64]) -> Result<(), Failure> {
        during_run(SIDE, "truth", |py| {
            let command = self.shape.command.instance(py, command)?;
            let instance = self.instance.bind(py);
            let row = instance.call_method1(intern!(py, "truth"), (time_s, command))?;
            self.shape.truth.read(&row, truth, "truth")
        })
    }

    fn advance(&mut self, interval: &time::Interval, command: &[f64]) -> Result<(), Failure> {
        during_run(SIDE, "advance", |py| {
            let command = self.shape.command.instance(py, command)?;
            let interval = Interval::from(interval);
            let instance = self.instance.bind(py);
            super::tables::nothing(
                &instance.call_method1(intern!(py, "advance"), (interval, command))?,
                "advance",
            )
        })
    }

    fn save(&self) -> Result<State, Invalid> {
        between_steps("save", |py| self.shape.saving.save(self.instance.bind(py)))
    }

    fn restore(&mut self, state: &State) -> Result<(), Invalid> {
        between_steps("restore", |py| {
            (self.shape.saving).restore(self.instance.bind(py), state)
        })
    }

    fn numbers(&self) -> Result<Vec<f64>, Invalid> {
        between_steps("state", |py| {
            self.shape.saving.numbers(self.instance.bind(py))
        })
    }

    fn set_numbers(&mut self, numbers: &[f64]) -> Result<(), Invalid> {
        between_steps("state", |py| {
            (self.shape.saving).set_numbers(self.instance.bind(py), numbers)
        })
    }
}
