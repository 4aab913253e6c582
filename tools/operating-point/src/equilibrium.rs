//! The result of `hil trim`, as JSON and as text for people. Solves nothing.

use std::fmt::Write;
use std::path::PathBuf;

use hil_console::terminal::output;
use serde::Serialize;
use shared_types::local_map::Variable;
use shared_types::number::exact_in;

use crate::limits::Exceeded;
use crate::modes;

/// Equilibrium with what is to be known of it.
#[derive(Debug, Serialize)]
pub(crate) struct Equilibrium {
    pub(crate) scenario: String,
    pub(crate) time_s: f64,
    pub(crate) step: u64,
    pub(crate) states: Vec<Row>,
    pub(crate) inputs: Vec<Variable>,
    pub(crate) outputs: Vec<Variable>,
    pub(crate) evaluations: u32,
    /// Largest magnitude of an eigenvalue of the plant's map.
    pub(crate) largest_eigenvalue: f64,
    pub(crate) is_stable: bool,
    /// Numbers that the equations do not determine; they are closest to the point.
    pub(crate) undetermined: Vec<String>,
    /// Numbers beyond a limit of the plant or the range of an instrument.
    pub(crate) exceeded: Vec<Exceeded>,
    /// Faults and changes of the scenario that begin or end after the point.
    pub(crate) still_to_come: Vec<String>,
    /// State of the law, and the reason if the law does not hold the equilibrium.
    pub(crate) law: Law,
    /// Largest relative residual of a state at later times.
    pub(crate) later_residual: f64,
    pub(crate) checkpoint: PathBuf,
}

/// State with its residual.
#[derive(Debug, Serialize)]
pub(crate) struct Row {
    #[serde(flatten)]
    pub(crate) variable: Variable,
    pub(crate) residual: f64,
}

/// Law at the equilibrium.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Law {
    pub(crate) states: Vec<Variable>,
    pub(crate) refused: Option<String>,
}

impl Equilibrium {
    /// Describes the equilibrium for people.
    pub(crate) fn text(&self) -> String {
        output::text(|text| self.write(text))
    }

    fn write(&self, text: &mut String) -> std::fmt::Result {
        let at = exact_in(self.time_s, "s");
        writeln!(
            text,
            "equilibrium of {} at {at}, after {} evaluations",
            self.scenario, self.evaluations
        )?;
        for Row { variable, residual } in &self.states {
            let (name, value) = (&variable.name, exact_in(variable.value, &variable.unit));
            writeln!(
                text,
                "  {name} = {value}, which changes by {residual:.1e} in a step"
            )?;
        }
        for input in &self.inputs {
            writeln!(
                text,
                "  {} = {}",
                input.name,
                exact_in(input.value, &input.unit)
            )?;
        }
        if !self.undetermined.is_empty() {
            let names = self.undetermined.join(", ");
            writeln!(text, "not the only one: closest to the point in {names}")?;
        }
        let magnitude = self.largest_eigenvalue;
        if !self.is_stable {
            let what = match modes::integrates(magnitude) {
                true => "integrates",
                false => "is not stable",
            };
            writeln!(
                text,
                "the plant {what} there: an eigenvalue has the magnitude {magnitude}"
            )?;
        }
        if self.later_residual > 1e-9 {
            let later = self.later_residual;
            writeln!(
                text,
                "the plant depends on time: later in the run a state changes by {later:.1e} of the size of its equation in a step, so the run will not stay"
            )?;
        }
        for one in &self.exceeded {
            writeln!(text, "beyond a limit: {}", one.described())?;
        }
        for event in &self.still_to_come {
            writeln!(text, "still to come in the scenario: {event}")?;
        }
        match &self.law.refused {
            None => writeln!(text, "the law holds it")?,
            Some(reason) => writeln!(
                text,
                "the law does not hold it, and keeps its state: {reason}"
            )?,
        }
        writeln!(text, "hil run --from {}", self.checkpoint.display())
    }
}
