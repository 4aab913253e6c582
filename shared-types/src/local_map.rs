//! The map of one side at a point and its derivatives: question and answer of `--linearise`.
//!
//! Both programs answer with the same form. The map is `x(k+1) = f(x, u)`, `y = g(x, u)` over one period of the side,
//! on the rows by which its state is named. Nothing here knows a plant or a law.

use serde::{Deserialize, Serialize};

use crate::describe::{Invalid, Settings};
use crate::difference::{Derivative, Kinks, NoDerivative, derivative, is_hidden};
use crate::extremes::larger;
use crate::number::exact;
use crate::table::Field;
use crate::time::Step;

/// Question about a side whose job is a `J`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Question<J> {
    /// Job of the side. The state that it resumes from is that of the point, else the state at step 0; the side writes
    /// its state at the point where the job saves one.
    pub job: J,
    /// Step of the point.
    pub step: Step,
    /// Rows of the state that differ from the saved state.
    #[serde(default, skip_serializing_if = "Settings::is_empty")]
    pub state: Settings,
    /// Value of each input.
    pub inputs: Settings,
    /// `true` to pass kinks, where no linear model is asked for but the direction of an iteration.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub passes_kinks: bool,
    /// Commands to send, for a law that takes those of the plant.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub commands: Vec<Field>,
}

/// Number of the map at the point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Variable {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Value at the point.
    pub value: f64,
}

/// Accuracy of the derivatives by one number.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Accuracy {
    /// Step of the differences, in the unit of the number.
    pub step: f64,
    /// Largest relative error of a derivative by the number.
    pub error: f64,
}

/// Answer: the map at the point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LocalMap {
    /// Period of the map in s.
    pub period_s: f64,
    /// State x.
    pub states: Vec<Variable>,
    /// Inputs u.
    pub inputs: Vec<Variable>,
    /// Outputs y.
    pub outputs: Vec<Variable>,
    /// Truth of a plant at the point.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub truth: Vec<Variable>,
    /// State one period later.
    pub next: Vec<f64>,
    /// Derivatives of the next state, then of the outputs, by each state and then each input: a column each.
    pub columns: Vec<Vec<f64>>,
    /// Accuracy of each column.
    pub accuracy: Vec<Accuracy>,
    /// `true` if the model itself stated the derivatives of its continuous equations: the first rows are those of the
    /// rates of the states and not of the next states, and `next` is empty.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_continuous: bool,
}

/// Numbers of a map in order: states, inputs and outputs.
#[derive(Clone, Copy, Debug)]
pub struct Columns<'a> {
    /// Rows of the state.
    pub states: &'a [Field],
    /// Inputs.
    pub inputs: &'a [Field],
    /// Outputs.
    pub outputs: &'a [Field],
}

/// Map of a period: from the states and the inputs to the next states and the outputs.
pub type Map<'a> = dyn FnMut(&[f64]) -> Result<Vec<f64>, Invalid> + 'a;

impl LocalMap {
    /// Evaluates and differentiates a map at a point. `map` returns the next state, then the outputs; `point` has the
    /// states, then the inputs.
    ///
    /// # Errors
    /// If the map fails at the point, or has no derivative by a number there; the error names both numbers.
    pub fn at(
        columns: Columns<'_>,
        period_s: f64,
        (point, passes_kinks): (&[f64], bool),
        map: &mut Map<'_>,
    ) -> Result<Self, Invalid> {
        let Columns {
            states,
            inputs,
            outputs,
        } = columns;
        let here = map(point)?;
        let numbers: Vec<&Field> = states.iter().chain(inputs).collect();
        let results: Vec<&Field> = states.iter().chain(outputs).collect();
        for (field, value) in results.iter().zip(&here) {
            if !value.is_finite() {
                return Err(Invalid(format!("`{}` is {value} at the point", field.name)));
            }
        }
        let kinks = match passes_kinks {
            true => Kinks::Passed,
            false => Kinks::Refused,
        };
        let mut all = Vec::with_capacity(numbers.len());
        let mut column = |place: usize, terms: &[f64]| {
            let mut moved = point.to_vec();
            let mut by_one = |value: f64| {
                moved[place] = value;
                map(&moved).map_err(|error| error.0)
            };
            let column = derivative(&mut by_one, point[place], kinks, terms);
            column.map_err(|error| in_words(&error, numbers[place], point[place], &results))
        };
        for place in 0..numbers.len() {
            all.push(column(place, &[])?);
        }
        // Where large terms of a result cancel, it rounds as they do.
        let terms: Vec<f64> = (0..results.len())
            .map(|row| {
                let terms = all.iter().zip(point);
                let terms = terms.map(|(column, value)| (column.values[row] * value).abs());
                terms.fold(0.0, larger)
            })
            .collect();
        for (place, derivative) in all.iter_mut().enumerate() {
            if is_hidden(derivative, point[place], &terms) {
                *derivative = column(place, &terms)?;
            }
        }
        Ok(Self {
            period_s,
            states: variables(states, point),
            inputs: variables(inputs, &point[states.len()..]),
            outputs: variables(outputs, &here[states.len()..]),
            truth: Vec::new(),
            next: here[..states.len()].to_vec(),
            accuracy: { all.iter() }
                .map(|Derivative { step, error, .. }| Accuracy {
                    step: *step,
                    error: *error,
                })
                .collect(),
            columns: all.into_iter().map(|column| column.values).collect(),
            is_continuous: false,
        })
    }
}

/// Returns the numbers of a table with their values.
#[must_use]
pub fn variables(fields: &[Field], values: &[f64]) -> Vec<Variable> {
    let variable = |(field, value): (&Field, &f64)| Variable {
        name: field.name.clone(),
        unit: field.unit.clone(),
        value: *value,
    };
    fields.iter().zip(values).map(variable).collect()
}

/// Returns the values of a state: those saved, with the changed rows.
///
/// # Errors
/// If a changed row is not one of the state.
pub fn changed(fields: &[Field], saved: &[f64], changes: &Settings) -> Result<Vec<f64>, Invalid> {
    if let Some(name) = { changes.0.keys() }.find(|name| !fields.iter().any(|f| f.name == **name)) {
        return Err(Invalid(format!("the state has no row `{name}`")));
    }
    let value = |(field, saved): (&Field, &f64)| changes.get(&field.name).unwrap_or(*saved);
    Ok(fields.iter().zip(saved).map(value).collect())
}

/// Describes a missing derivative by the number `by`, whose value is `at`.
fn in_words(error: &NoDerivative, by: &Field, at: f64, results: &[&Field]) -> Invalid {
    let name = |output: &usize| &results[*output].name;
    let at = format!("`{}` = {} {}", by.name, exact(at), by.unit);
    Invalid(match error {
        NoDerivative::Failed(reason) => format!("the map fails at {at}: {reason}"),
        NoDerivative::Kink {
            output,
            left,
            right,
        } => format!(
            "no linear model: `{}` has a kink at {at}; its slope is {left:e} to the left and {right:e} to the right",
            name(output)
        ),
        NoDerivative::Jump {
            output,
            left,
            right,
        } => format!(
            "no linear model: `{}` jumps at {at}, by {left:e} from the left and by {right:e} to the right",
            name(output)
        ),
        NoDerivative::Diverges {
            output,
            value,
            error,
        } => format!(
            "no linear model: the slope of `{}` at {at} does not converge with smaller steps; the best is {value:e} with an error of {error:e}",
            name(output)
        ),
    })
}
