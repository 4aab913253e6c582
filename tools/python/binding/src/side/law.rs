//! A class as a [`LawKind`].

use std::sync::Arc;

use controller_process::controller::{Answer, Law, LawKind, Row, SetupRows, Transition, TunedRows};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use pyo3::{Py, intern};
use shared_types::describe::{Invalid, LawDescription};
use shared_types::failure::Failure;
use shared_types::quality::{self, SignalSet};
use shared_types::side::Side;
use shared_types::state::State;

use super::arguments::{Quality, Sample, Setup};
use super::failure::{between_steps, declaration, during_run};
use super::saving::Saving;
use super::tables::{Rows, nothing};

/// Side of the classes here.
const SIDE: Side = Side::Controller;

/// Class of a law.
struct Shape {
    class: Py<PyAny>,
    parameters: Rows,
    model: Rows,
    /// Measured and reference signals.
    inputs: Arc<[Rows; 2]>,
    command: Rows,
    internals: Rows,
    saving: Saving,
    marks_held: bool,
}

/// Instance of the class.
struct InPython {
    shape: Arc<Shape>,
    instance: Py<PyAny>,
    /// Failure of a change of parameters, reported at the next step.
    pending: Option<Failure>,
}

/// Returns the law of a class that is marked with `@hil.law`.
///
/// # Errors
/// If the class is not marked, or a table breaks a rule; the exception names the row.
pub(crate) fn law_kind(class: &Bound<'_, PyAny>) -> PyResult<LawKind> {
    let side = super::declaration(class, "law")?;
    let methods: Vec<String> = side.getattr("methods")?.extract()?;
    let has = |name: &str| methods.iter().any(|method| method == name);
    let table = |role| Rows::of_role(&side, role);
    let shape = Shape {
        class: class.clone().unbind(),
        parameters: table("parameters")?,
        model: table("model")?,
        inputs: Arc::new([table("measured")?, table("reference")?]),
        command: table("command")?,
        internals: table("internals")?,
        saving: Saving::of(&side, has("save"))?,
        marks_held: has("held"),
    };
    let description = LawDescription {
        name: side.getattr("name")?.extract()?,
        summary: side.getattr("summary")?.extract()?,
        plants: side.getattr("plants")?.extract()?,
        parameters: shape.parameters.fields.clone(),
        model: shape.model.fields.clone(),
        measured: shape.inputs[0].fields.clone(),
        reference: shape.inputs[1].fields.clone(),
        commands: Some(shape.command.fields.clone()),
        internals: shape.internals.fields.clone(),
        saves: shape.saving.saves(),
        state: shape.saving.fields(),
        tuning: side.getattr("tuning")?.extract()?,
    };
    let shape = Arc::new(shape);
    let kind = LawKind::from_tables(description, move |rows: &SetupRows<'_>| {
        let instance = between_steps("__init__", |py| {
            let setup = shape.setup(py, rows.parameters, rows.model, rows.period_s)?;
            Ok(shape.class.bind(py).call1((setup,))?.unbind())
        })?;
        Ok(Box::new(InPython {
            shape: Arc::clone(&shape),
            instance,
            pending: None,
        }))
    });
    kind.map_err(|invalid| declaration(class.py(), invalid.to_string()))
}

impl Shape {
    fn setup(
        &self,
        py: Python<'_>,
        parameters: &[f64],
        model: &[f64],
        period_s: f64,
    ) -> PyResult<Setup> {
        Ok(Setup {
            parameters: self.parameters.instance(py, parameters)?.unbind(),
            model: self.model.instance(py, model)?.unbind(),
            period_s,
        })
    }

    /// Returns a sample as an object.
    fn sample(
        &self,
        py: Python<'_>,
        row: &Row<'_>,
        quality: &quality::Quality<'_>,
    ) -> PyResult<Sample> {
        let [measured, reference] = &*self.inputs;
        Ok(Sample {
            time_s: row.time_s,
            measured: measured.instance(py, row.measured)?.unbind(),
            reference: reference.instance(py, row.reference)?.unbind(),
            valid: row.valid,
            held_steps: row.held_steps,
            quality: Some(Quality {
                tables: Arc::clone(&self.inputs),
                invalid: [*quality.measured, *quality.reference],
                age_steps: quality.age_steps.into(),
            }),
        })
    }

    /// Writes the rows of an answer: a command, or a command and internals.
    fn read(
        &self,
        answer: &Bound<'_, PyAny>,
        command: &mut [f64],
        internals: &mut [f64],
    ) -> PyResult<()> {
        if internals.is_empty() && !answer.is_instance_of::<PyTuple>() {
            return self.command.read(answer, command, "step");
        }
        let both = answer.extract::<(Bound<'_, PyAny>, Bound<'_, PyAny>)>();
        let (commanded, inner) = both.map_err(|_| {
            let kind = answer.get_type().name();
            let kind = kind.map_or_else(|_| "another object".into(), |name| name.to_string());
            PyTypeError::new_err(format!(
                "`step` returned {kind}; it must return its command and its internals, as a tuple"
            ))
        })?;
        self.command.read(&commanded, command, "step")?;
        self.internals.read(&inner, internals, "step")
    }
}

impl Law for InPython {
    fn step(
        &mut self,
        row: &Row<'_>,
        command: &mut [f64],
        internals: &mut [f64],
    ) -> Result<(), Failure> {
        let none = SignalSet::EMPTY;
        let mut held = none;
        let quality = quality::Quality {
            measured: &none,
            reference: &none,
            age_steps: &vec![0; row.measured.len()],
        };
        let answer = Answer {
            command,
            internals,
            held: &mut held,
        };
        Law::answer(self, row, &quality, answer)
    }

    fn answer(
        &mut self,
        row: &Row<'_>,
        quality: &quality::Quality<'_>,
        answer: Answer<'_>,
    ) -> Result<(), Failure> {
        if let Some(failure) = self.pending.take() {
            return Err(failure);
        }
        let Answer {
            command,
            internals,
            held,
        } = answer;
        during_run(SIDE, "step", |py| {
            let instance = self.instance.bind(py);
            let sample = self.shape.sample(py, row, quality)?;
            let answer = instance.call_method1(intern!(py, "step"), (sample,))?;
            self.shape.read(&answer, command, internals)?;
            if self.shape.marks_held {
                let names = instance.call_method0(intern!(py, "held"))?;
                self.shape.command.mark(&names, held, "held")?;
            }
            Ok(())
        })
    }

    fn retune(&mut self, rows: &TunedRows<'_>, transition: Transition) {
        let result = during_run(SIDE, "retune", |py| {
            let (parameters, model) = (rows.parameters, rows.model);
            let setup = self.shape.setup(py, parameters, model, rows.period_s)?;
            let is_ramp = transition == Transition::Ramp;
            let instance = self.instance.bind(py);
            nothing(
                &instance.call_method1(intern!(py, "retune"), (setup, is_ramp))?,
                "retune",
            )
        });
        self.pending = result.err();
    }

    fn save(&self) -> Result<State, Invalid> {
        between_steps("save", |py| self.shape.saving.save(self.instance.bind(py)))
    }

    fn restore(&mut self, state: &State) -> Result<(), Invalid> {
        self.pending = None;
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
