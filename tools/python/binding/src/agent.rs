//! Agent that chooses the commands of a session from Python, in place of a law.
//!
//! The commands come from memory that an array of numpy shows.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use controller_process::controller::{Law, LawKind, Row, Start, Transition, TunedRows};
use pyo3::prelude::*;
use pyo3::types::PyByteArray;
use shared_types::describe::{Invalid, LawDescription};
use shared_types::failure::Failure;
use shared_types::state::{State, check_count};

/// Name of the law in a scenario.
const NAME: &str = "agent";

/// Commands that an agent has chosen.
#[derive(Clone, Default)]
struct Chosen(Arc<Mutex<Vec<f64>>>);

impl Chosen {
    fn lock(&self) -> MutexGuard<'_, Vec<f64>> {
        // No operation under this lock can be left incomplete.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Agent in the place of a law.
#[pyclass(frozen, module = "hil._native")]
pub(crate) struct Agent {
    chosen: Chosen,
    kind: Arc<LawKind>,
}

#[pymethods]
impl Agent {
    /// Creates an agent, for one session.
    #[new]
    fn new() -> Self {
        let chosen = Chosen::default();
        let kind = Arc::new(kind(chosen.clone()));
        Self { chosen, kind }
    }

    /// Creates memory for the commands, which begins with their present values: 8 bytes each, in the order of this
    /// machine.
    fn memory(&self, py: Python<'_>) -> Py<PyByteArray> {
        let chosen = self.chosen.lock();
        let bytes: Vec<u8> = chosen.iter().flat_map(|one| one.to_ne_bytes()).collect();
        PyByteArray::new(py, &bytes).unbind()
    }

    /// Chooses the commands in the memory for all steps that follow.
    fn choose(&self, memory: &Bound<'_, PyByteArray>) {
        // SAFETY: the interpreter is attached and nothing here calls it, so no other code changes the memory meanwhile.
        let bytes = unsafe { memory.as_bytes() };
        let (chunks, _) = bytes.as_chunks();
        for (command, chunk) in self.chosen.lock().iter_mut().zip(chunks) {
            *command = f64::from_ne_bytes(*chunk);
        }
    }
}

impl Agent {
    /// Returns the law of this agent.
    pub(crate) fn kind(&self) -> Arc<LawKind> {
        Arc::clone(&self.kind)
    }
}

/// Law that sends the chosen commands.
struct Choosing(Chosen);

impl Law for Choosing {
    fn step(
        &mut self,
        _sample: &Row<'_>,
        command: &mut [f64],
        _internals: &mut [f64],
    ) -> Result<(), Failure> {
        command.copy_from_slice(&self.0.lock());
        Ok(())
    }

    fn save(&self) -> Result<State, Invalid> {
        State::of(&*self.0.lock())
    }

    fn restore(&mut self, state: &State) -> Result<(), Invalid> {
        let commands: Vec<f64> = state.read()?;
        let mut chosen = self.0.lock();
        check_count(chosen.len(), commands.len())?;
        *chosen = commands;
        Ok(())
    }

    /// Returns nothing: the commands come from outside.
    fn numbers(&self) -> Result<Vec<f64>, Invalid> {
        Ok(Vec::new())
    }

    fn set_numbers(&mut self, numbers: &[f64]) -> Result<(), Invalid> {
        check_count(0, numbers.len())
    }

    fn retune(&mut self, _setup: &TunedRows<'_>, _transition: Transition) {}
}

/// Creates the law of chosen commands, which begin with the start values that the plant declares, else 0.
fn kind(chosen: Chosen) -> LawKind {
    let start = move |start: &Start<'_>| -> Result<Box<dyn Law>, Invalid> {
        let starts = start.commands.iter();
        *chosen.lock() = starts.map(|field| field.default.unwrap_or(0.0)).collect();
        Ok(Box::new(Choosing(chosen.clone())))
    };
    LawKind {
        description: LawDescription {
            name: NAME.into(),
            summary: "Sends the commands that an agent in Python chooses.".into(),
            plants: Vec::new(),
            parameters: Vec::new(),
            model: Vec::new(),
            measured: Vec::new(),
            reference: Vec::new(),
            commands: None,
            internals: Vec::new(),
            saves: true,
            state: Some(Vec::new()),
            tuning: String::new(),
        },
        start: Box::new(start),
    }
}
