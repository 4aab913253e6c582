//! The result of a linearisation as JSON, and as a table for people. Computes the continuous matrices and the modes,
//! and nothing else.

use std::fmt::Write;

use hil_console::terminal::output;
use hil_console::terminal::table::{Table, left, right};
use serde::Serialize;
use shared_types::local_map::{Accuracy, Variable};
use shared_types::number::{counted, exact, exact_in};

use crate::continuous::{self, Continuous};
use crate::model::{LinearModel, rows};
use crate::modes::{self, Mode};

/// Version of the file's format.
const SCHEMA: u32 = 1;

/// Linear model as a file.
#[derive(Debug, Serialize)]
pub(crate) struct File {
    schema: u32,
    scenario: String,
    of: &'static str,
    time_s: f64,
    step: u64,
    period_s: f64,
    states: Vec<Named>,
    inputs: Vec<Named>,
    outputs: Vec<Variable>,
    /// Rows of the state on which nothing depends at this point.
    left_out: Vec<String>,
    /// Source of the derivatives.
    derivatives: Source,
    discrete: Matrices,
    continuous: Option<Matrices>,
    /// Reason why there are no continuous matrices.
    continuous_refused: Option<String>,
    eigenvalues: Vec<Mode>,
    is_stable: bool,
}

/// Source of derivatives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Source {
    /// Differences of the discrete map.
    Differences,
    /// Directional derivatives of the continuous equations, by the FMU itself.
    Directional,
}

/// State or input with the accuracy of its column.
#[derive(Debug, Serialize)]
struct Named {
    #[serde(flatten)]
    variable: Variable,
    #[serde(flatten)]
    accuracy: Accuracy,
}

/// Matrices, row by row.
#[derive(Debug, Serialize)]
struct Matrices {
    #[serde(rename = "A")]
    a: Vec<Vec<f64>>,
    #[serde(rename = "B")]
    b: Vec<Vec<f64>>,
    #[serde(rename = "C")]
    c: Vec<Vec<f64>>,
    #[serde(rename = "D")]
    d: Vec<Vec<f64>>,
}

/// Origin of a model.
pub(crate) struct Origin<'a> {
    pub(crate) scenario: &'a str,
    pub(crate) of: &'static str,
    pub(crate) time_s: f64,
    pub(crate) step: u64,
}

impl File {
    /// Derives the file of a model.
    ///
    /// # Errors
    /// If the eigenvalues cannot be computed.
    pub(crate) fn of(model: &LinearModel, origin: &Origin<'_>) -> Result<Self, String> {
        let named = |variables: &[Variable], accuracy: &[Accuracy]| {
            let both = variables.iter().zip(accuracy);
            both.map(|(variable, accuracy)| Named {
                variable: variable.clone(),
                accuracy: *accuracy,
            })
            .collect()
        };
        let (states, inputs) = model.accuracy.split_at(model.states.len());
        let (c, d) = (rows(&model.c), rows(&model.d));
        let continuous = match &model.continuous {
            Some([a, b]) => Ok(Continuous {
                a: a.clone(),
                b: b.clone(),
            }),
            None => continuous::of(model),
        };
        let eigenvalues = modes::of(&model.a, model.period_s)?;
        Ok(Self {
            schema: SCHEMA,
            scenario: origin.scenario.into(),
            of: origin.of,
            time_s: origin.time_s,
            step: origin.step,
            period_s: model.period_s,
            states: named(&model.states, states),
            inputs: named(&model.inputs, inputs),
            outputs: model.outputs.clone(),
            left_out: model.left_out.clone(),
            derivatives: match model.continuous {
                Some(_) => Source::Directional,
                None => Source::Differences,
            },
            discrete: Matrices {
                a: rows(&model.a),
                b: rows(&model.b),
                c: c.clone(),
                d: d.clone(),
            },
            continuous_refused: continuous.as_ref().err().cloned(),
            continuous: continuous.ok().map(|continuous| Matrices {
                a: rows(&continuous.a),
                b: rows(&continuous.b),
                c,
                d,
            }),
            is_stable: eigenvalues.iter().all(Mode::decays),
            eigenvalues,
        })
    }

    /// Formats the model for people, without the matrices.
    pub(crate) fn text(&self) -> String {
        output::text(|text| self.write(text))
    }

    fn write(&self, text: &mut String) -> std::fmt::Result {
        let (at, period) = (exact_in(self.time_s, "s"), exact_in(self.period_s, "s"));
        let count = |count: usize, noun: &str| counted(count as u64, noun);
        let sizes = (
            count(self.states.len(), "state"),
            count(self.inputs.len(), "input"),
            count(self.outputs.len(), "output"),
        );
        writeln!(
            text,
            "{} of {} at {at}: {}, {}, {}, period {period}",
            self.of, self.scenario, sizes.0, sizes.1, sizes.2
        )?;
        if !self.left_out.is_empty() {
            let names = self.left_out.join(", ");
            writeln!(
                text,
                "left out, because nothing depends on them here: {names}"
            )?;
        }
        let numbers: Vec<&Named> = self.states.iter().chain(&self.inputs).collect();
        let longest = |of: fn(&Named) -> usize| { numbers.iter() }.map(|one| of(one)).max();
        let name = longest(|one| one.variable.name.len()).unwrap_or_default() + 2;
        let unit = longest(|one| one.variable.unit.len())
            .unwrap_or_default()
            .max(4)
            + 2;
        let mut table = Table::new(2, [left(name), right(14), left(unit), right(12), right(12)]);
        table.cells(["number", "value", "  unit", "step", "error"]);
        for Named { variable, accuracy } in numbers {
            let value = format!("{:.6e}", variable.value);
            let unit = format!("  {}", variable.unit);
            let step = format!("{:.2e}", accuracy.step);
            let error = format!("{:.1e}", accuracy.error);
            table.row(&[&variable.name, &value, &unit, &step, &error]);
        }
        write!(text, "{table}")?;
        if self.derivatives == Source::Directional {
            writeln!(
                text,
                "directional derivatives of the FMU; its inputs are held over each period"
            )?;
        }
        let mut table = Table::new(2, [left(28), right(14), right(14), right(12)]);
        table.cells(["eigenvalue", "magnitude", "frequency Hz", "damping"]);
        for mode in &self.eigenvalues {
            let sign = if mode.im < 0.0 { '-' } else { '+' };
            let z = match mode.im == 0.0 {
                true => format!("{:.9}", mode.re),
                false => format!("{:.9} {sign} {:.9}i", mode.re, mode.im.abs()),
            };
            let or_none =
                |value: Option<f64>| value.map_or("-".into(), |value| format!("{value:.6}"));
            let magnitude = format!("{:.9}", mode.magnitude);
            table.row(&[
                &z,
                &magnitude,
                &or_none(mode.frequency_hz),
                &or_none(mode.damping),
            ]);
        }
        write!(text, "{table}")?;
        let largest = self.eigenvalues.first().map_or(0.0, |mode| mode.magnitude);
        writeln!(
            text,
            "{}: the largest magnitude is {}",
            match (self.is_stable, modes::integrates(largest)) {
                (true, _) => "stable",
                (false, true) => "integrates",
                (false, false) => "not stable",
            },
            exact(largest)
        )?;
        match &self.continuous_refused {
            Some(reason) => writeln!(text, "no continuous model: {reason}"),
            None => Ok(()),
        }
    }
}
